//! Kernels of a technique in the variant that fits the scene, or the general one until that is compiled.

use surfelcast_gpu::{Gpu, GpuError, Kernel};
use surfelcast_shaders::Features;

/// Kernels by name.
#[derive(Clone, Debug)]
pub struct KernelSet {
    /// Variant that fits.
    features: Features,
    running: Features,
    kernels: Vec<Kernel>,
    names: Vec<&'static str>,
}

impl KernelSet {
    /// The fitting variants, compiled now if `waits`; otherwise the general ones until those are ready.
    pub fn new(
        gpu: &Gpu,
        names: Vec<&'static str>,
        features: Features,
        general: Features,
        waits: bool,
    ) -> Result<Self, GpuError> {
        let is_ready = |name: &&str| gpu.kernel_if_ready(name, features).is_some();
        let running = if waits || names.iter().all(is_ready) { features } else { general };
        let kernels = names.iter().map(|name| gpu.kernel(name, running)).collect::<Result<_, _>>()?;
        Ok(Self { features, running, kernels, names })
    }

    /// Changes to the fitting variants as soon as all are compiled.
    pub fn refresh(&mut self, gpu: &Gpu) {
        if self.running == self.features {
            return;
        }
        for name in &self.names {
            gpu.prepare(name, self.features);
        }
        let ready: Option<Vec<Kernel>> =
            self.names.iter().map(|name| gpu.kernel_if_ready(name, self.features)).collect();
        if let Some(kernels) = ready {
            self.kernels = kernels;
            self.running = self.features;
        }
    }

    /// Variant in use.
    pub fn running(&self) -> Features {
        self.running
    }

    /// Variant that fits the scene.
    pub fn features(&self) -> Features {
        self.features
    }

    /// A kernel of the set.
    pub fn get(&self, name: &str) -> Result<&Kernel, GpuError> {
        let index = self.names.iter().position(|known| *known == name);
        index.and_then(|index| self.kernels.get(index)).ok_or_else(|| GpuError::Validation {
            context: "kernels of a technique".to_owned(),
            message: format!("`{name}` is not among them"),
        })
    }
}
