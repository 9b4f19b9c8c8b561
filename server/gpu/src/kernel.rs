//! Kernels: linked, compiled, cached. Two variants that link to the same text share one pipeline.
//!
//! The device owns its kernels and compiling needs the device, so `device.rs` and this file import each other.

use std::collections::HashMap;
use std::fmt;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::mpsc::{SyncSender, TrySendError, sync_channel};
use std::sync::{Arc, Weak};
use std::thread;

use parking_lot::{Condvar, Mutex};
use surfelcast_shaders::{
    Access, Binding, FRAGMENT_SUFFIX, Features, LinkedKernel, Reflection, VERTEX_SUFFIX, link, link_source,
};

use crate::device::Inner;
use crate::error::GpuError;

/// Kernels that may wait for the background compiler.
const QUEUE_CAPACITY: usize = 256;

/// A compiled kernel. Clones share it.
#[derive(Clone)]
pub struct Kernel {
    pub(crate) inner: Arc<KernelInner>,
}

pub(crate) struct KernelInner {
    pub(crate) reflection: Reflection,
    /// By group; `None` for a group that the kernel does not use.
    pub(crate) layouts: Vec<Option<wgpu::BindGroupLayout>>,
    pub(crate) pipeline: Pipeline,
    pub(crate) device_id: u64,
}

pub(crate) enum Pipeline {
    Compute(wgpu::ComputePipeline),
    Raster(wgpu::RenderPipeline),
}

impl Kernel {
    /// Name of kernel, entry point and pass.
    pub fn name(&self) -> &str {
        &self.inner.reflection.entry_point
    }

    /// What it binds.
    pub fn reflection(&self) -> &Reflection {
        &self.inner.reflection
    }

    /// Whether it has a binding of that name; a variant may lack one that another has.
    pub fn binds(&self, name: &str) -> bool {
        self.inner.reflection.bindings.iter().any(|binding| binding.name == name)
    }
}

impl fmt::Debug for Kernel {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "Kernel(`{}`)", self.name())
    }
}

#[derive(Clone)]
enum State {
    Compiling,
    Ready(Kernel),
    Failed(GpuError),
}

type Variant = (String, Features);

#[derive(Default)]
struct Table {
    variants: HashMap<Variant, State>,
    by_text: HashMap<[u8; 32], Kernel>,
    worker: Option<Worker>,
    is_stopping: bool,
}

/// The compiling thread and its queue.
struct Worker {
    sender: SyncSender<Variant>,
    thread: thread::JoinHandle<()>,
}

/// All kernels of a device.
#[derive(Default)]
pub(crate) struct KernelStore {
    table: Mutex<Table>,
    done: Condvar,
}

impl KernelStore {
    pub(crate) fn get(&self, gpu: &Inner, name: &str, features: Features) -> Result<Kernel, GpuError> {
        let variant = (name.to_owned(), features);
        {
            let mut table = self.table.lock();
            loop {
                match table.variants.get(&variant) {
                    Some(State::Ready(kernel)) => return Ok(kernel.clone()),
                    Some(State::Failed(error)) => return Err(error.clone()),
                    Some(State::Compiling) => self.done.wait(&mut table),
                    None => break,
                }
            }
            table.variants.insert(variant.clone(), State::Compiling);
        }
        self.compile(gpu, variant)
    }

    pub(crate) fn if_ready(&self, name: &str, features: Features) -> Option<Kernel> {
        match self.table.lock().variants.get(&(name.to_owned(), features)) {
            Some(State::Ready(kernel)) => Some(kernel.clone()),
            _ => None,
        }
    }

    pub(crate) fn prepare(&self, gpu: &Arc<Inner>, name: &str, features: Features) {
        let variant = (name.to_owned(), features);
        let mut table = self.table.lock();
        if table.is_stopping || table.variants.contains_key(&variant) {
            return;
        }
        if table.worker.is_none() {
            table.worker = start_worker(gpu);
        }
        let sent = match &table.worker {
            Some(worker) => match worker.sender.try_send(variant.clone()) {
                Ok(()) => true,
                // Requested again in the next frame; nothing is lost.
                Err(TrySendError::Full(_) | TrySendError::Disconnected(_)) => false,
            },
            None => false,
        };
        if sent {
            table.variants.insert(variant, State::Compiling);
        }
    }

    /// Ends background compilation: the current kernel is finished, the waiting ones are dropped. A process that ends
    /// while its driver compiles may crash.
    pub(crate) fn stop(&self) {
        let worker = {
            let mut table = self.table.lock();
            table.is_stopping = true;
            table.worker.take()
        };
        if let Some(Worker { sender, thread }) = worker {
            drop(sender);
            let _ = thread.join();
        }
    }

    /// Compiles a variant that is marked as being compiled, and wakes the threads that wait for it.
    fn compile(&self, gpu: &Inner, variant: Variant) -> Result<Kernel, GpuError> {
        let (name, features) = &variant;
        // The waiting threads must wake even if the compiler panics.
        let compiled = catch_unwind(AssertUnwindSafe(|| {
            link(name, *features)
                .map_err(|error| GpuError::Pipeline { kernel: name.clone(), message: error.to_string() })
                .and_then(|linked| self.share(gpu, &linked))
        }));
        let result = compiled.unwrap_or_else(|_| {
            Err(GpuError::Pipeline { kernel: name.clone(), message: "the compiler panicked".to_owned() })
        });
        let state = match &result {
            Ok(kernel) => State::Ready(kernel.clone()),
            Err(error) => State::Failed(error.clone()),
        };
        self.table.lock().variants.insert(variant, state);
        self.done.notify_all();
        result
    }

    pub(crate) fn compile_source(
        &self,
        gpu: &Inner,
        name: &str,
        text: &str,
        features: Features,
    ) -> Result<Kernel, GpuError> {
        let linked = link_source(name, text, features)
            .map_err(|error| GpuError::Pipeline { kernel: name.to_owned(), message: error.to_string() })?;
        self.share(gpu, &linked)
    }

    /// The pipeline of a text, created if it is new.
    fn share(&self, gpu: &Inner, linked: &LinkedKernel) -> Result<Kernel, GpuError> {
        if let Some(kernel) = self.table.lock().by_text.get(&linked.hash) {
            return Ok(kernel.clone());
        }
        let kernel = build(gpu, linked)?;
        self.table.lock().by_text.insert(linked.hash, kernel.clone());
        gpu.save_pipelines();
        Ok(kernel)
    }
}

/// The thread that compiles prepared kernels. It ends with the device.
fn start_worker(gpu: &Arc<Inner>) -> Option<Worker> {
    let (sender, receiver) = sync_channel::<Variant>(QUEUE_CAPACITY);
    let weak: Weak<Inner> = Arc::downgrade(gpu);
    let spawned = thread::Builder::new().name("shader-compiler".to_owned()).spawn(move || {
        while let Ok(variant) = receiver.recv() {
            let Some(gpu) = weak.upgrade() else { return };
            if gpu.kernels.table.lock().is_stopping {
                return;
            }
            if let Err(error) = gpu.kernels.compile(&gpu, variant) {
                tracing::error!(target: "surfelcast::gpu", %error, "a kernel did not compile in the background");
            }
        }
    });
    match spawned {
        Ok(thread) => Some(Worker { sender, thread }),
        Err(error) => {
            tracing::warn!(target: "surfelcast::gpu", %error, "no thread for background compilation");
            None
        }
    }
}

fn build(gpu: &Inner, linked: &LinkedKernel) -> Result<Kernel, GpuError> {
    gpu.check()?;
    let failed = |message: String| GpuError::Pipeline { kernel: linked.name.clone(), message };
    let reflection = &linked.reflection;
    fits(gpu, reflection).map_err(failed)?;
    // Only a device that can draw has a target format.
    let target_format = if reflection.target_count > 0 { Some(gpu.raster()?) } else { None };
    let group_count = reflection.bindings.iter().map(|binding| binding.group as usize + 1).max().unwrap_or(0);
    let result = gpu.scoped(&linked.name, 0, || {
        let layouts: Vec<Option<wgpu::BindGroupLayout>> =
            (0..group_count).map(|group| layout(&gpu.device, reflection, group as u32)).collect();
        let layout_refs: Vec<Option<&wgpu::BindGroupLayout>> = layouts.iter().map(Option::as_ref).collect();
        let pipeline_layout = gpu.device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
            label: Some(&linked.name),
            bind_group_layouts: &layout_refs,
            immediate_size: 0,
        });
        let module = gpu.device.create_shader_module(wgpu::ShaderModuleDescriptor {
            label: Some(&linked.name),
            source: wgpu::ShaderSource::Wgsl(linked.wgsl.as_str().into()),
        });
        let pipeline = match target_format {
            Some(format) => Pipeline::Raster(raster_pipeline(gpu, linked, &pipeline_layout, &module, format)),
            None => Pipeline::Compute(gpu.device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
                label: Some(&linked.name),
                layout: Some(&pipeline_layout),
                module: &module,
                entry_point: Some(&reflection.entry_point),
                compilation_options: wgpu::PipelineCompilationOptions::default(),
                cache: gpu.pipeline_cache.as_ref().map(|(_, cache)| cache),
            })),
        };
        (layouts, pipeline)
    });
    let (layouts, pipeline) = result.map_err(|error| match error {
        GpuError::Validation { message, .. } => failed(message),
        other => other,
    })?;
    Ok(Kernel { inner: Arc::new(KernelInner { reflection: reflection.clone(), layouts, pipeline, device_id: gpu.id }) })
}

/// Triangles without vertex buffers, back faces only, with additive blending.
fn raster_pipeline(
    gpu: &Inner,
    linked: &LinkedKernel,
    layout: &wgpu::PipelineLayout,
    module: &wgpu::ShaderModule,
    format: wgpu::TextureFormat,
) -> wgpu::RenderPipeline {
    let name = &linked.reflection.entry_point;
    let add = wgpu::BlendComponent {
        src_factor: wgpu::BlendFactor::One,
        dst_factor: wgpu::BlendFactor::One,
        operation: wgpu::BlendOperation::Add,
    };
    let target = Some(wgpu::ColorTargetState {
        format,
        blend: Some(wgpu::BlendState { color: add, alpha: add }),
        write_mask: wgpu::ColorWrites::ALL,
    });
    let targets = vec![target; linked.reflection.target_count as usize];
    gpu.device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
        label: Some(name),
        layout: Some(layout),
        vertex: wgpu::VertexState {
            module,
            entry_point: Some(&format!("{name}{VERTEX_SUFFIX}")),
            compilation_options: wgpu::PipelineCompilationOptions::default(),
            buffers: &[],
        },
        primitive: wgpu::PrimitiveState { cull_mode: Some(wgpu::Face::Front), ..wgpu::PrimitiveState::default() },
        depth_stencil: None,
        multisample: wgpu::MultisampleState::default(),
        fragment: Some(wgpu::FragmentState {
            module,
            entry_point: Some(&format!("{name}{FRAGMENT_SUFFIX}")),
            compilation_options: wgpu::PipelineCompilationOptions::default(),
            targets: &targets,
        }),
        multiview_mask: None,
        cache: gpu.pipeline_cache.as_ref().map(|(_, cache)| cache),
    })
}

/// Checks the kernel against the device's limits before the driver does, for a message that names limit and remedy.
fn fits(gpu: &Inner, reflection: &Reflection) -> Result<(), String> {
    let limits = &gpu.report.limits;
    let storage = reflection.bindings.iter().filter(|binding| binding.access.is_storage()).count();
    if storage > limits.storage_buffers_per_kernel as usize {
        return Err(format!(
            "it binds {storage} storage buffers, this device allows storage_buffers_per_kernel = {}; \
             merge buffers or switch features off",
            limits.storage_buffers_per_kernel
        ));
    }
    let invocations: u64 = reflection.workgroup_size.iter().map(|&size| u64::from(size)).product();
    if invocations > limits.workgroup_invocations.into() {
        return Err(format!(
            "its workgroup has {invocations} invocations, this device allows workgroup_invocations = {}",
            limits.workgroup_invocations
        ));
    }
    if let Some(binding) = reflection.bindings.iter().find(|binding| binding.group >= limits.bind_groups) {
        return Err(format!("`{}` is in group {}, there are {}", binding.name, binding.group, limits.bind_groups));
    }
    Ok(())
}

fn layout(device: &wgpu::Device, reflection: &Reflection, group: u32) -> Option<wgpu::BindGroupLayout> {
    let of_group = reflection.bindings.iter().filter(|binding| binding.group == group);
    let is_raster = reflection.target_count > 0;
    let stages = if is_raster { wgpu::ShaderStages::VERTEX_FRAGMENT } else { wgpu::ShaderStages::COMPUTE };
    let entries: Vec<wgpu::BindGroupLayoutEntry> = of_group
        .map(|binding| wgpu::BindGroupLayoutEntry {
            binding: binding.binding,
            visibility: stages,
            ty: binding_type(binding),
            count: None,
        })
        .collect();
    if entries.is_empty() {
        return None;
    }
    Some(device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor { label: None, entries: &entries }))
}

fn binding_type(binding: &Binding) -> wgpu::BindingType {
    let ty = match binding.access {
        Access::Uniform => wgpu::BufferBindingType::Uniform,
        Access::StorageRead => wgpu::BufferBindingType::Storage { read_only: true },
        Access::StorageReadWrite => wgpu::BufferBindingType::Storage { read_only: false },
        Access::Texture => {
            return wgpu::BindingType::Texture {
                sample_type: wgpu::TextureSampleType::Float { filterable: false },
                view_dimension: wgpu::TextureViewDimension::D2,
                multisampled: false,
            };
        }
    };
    let min_binding_size = std::num::NonZeroU64::new(binding.min_size.into());
    wgpu::BindingType::Buffer { ty, has_dynamic_offset: false, min_binding_size }
}
