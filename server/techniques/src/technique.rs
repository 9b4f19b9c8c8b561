//! What a technique is.

use std::sync::Arc;

use parking_lot::Mutex;
use surfelcast_gpu::{Buffer, Gpu, GpuError};
use surfelcast_scene::SceneSummary;
use surfelcast_shaders::Features;

use crate::session::SessionState;
use crate::surfel::{SurfelCache, SurfelSettings};
use surfelcast_passes::direct_light::EarlierFrame;
use surfelcast_passes::frame::FrameView;
use surfelcast_passes::lights::LightBuffers;
use surfelcast_passes::materials::MaterialMode;
use surfelcast_passes::step::{Step, StepBudget};
use surfelcast_passes::upload::SceneBuffers;

/// What changed since the last frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Change {
    /// Position, direction or field of view.
    Camera,
    /// Any light, the environment or emission strength.
    Lights,
    /// Where objects are, or whether they are visible. No technique keeps anything of its image across it.
    Transforms,
}

/// What is promised about a technique's picture; tests hold it to that.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Conformance {
    /// The expected picture is the truth at any number of samples.
    Unbiased,
    /// The picture converges to the truth.
    Consistent,
    /// The picture converges to within this tone-mapped RMSE of the truth.
    Biased {
        /// Bound.
        rmse_tonemapped: f32,
    },
}

/// What a technique is made with.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TechniqueOptions {
    /// Picture size in pixels.
    pub size: [u32; 2],
    /// Size at which it is shown: pictures of a gesture are made smaller, and what a session keeps must not follow that.
    pub full_size: [u32; 2],
    /// Materials.
    pub materials: MaterialMode,
    /// Direct and indirect light are kept apart too.
    pub is_split: bool,
    /// Seed of all random numbers.
    pub seed: u64,
    /// Whether to wait for the kernels' special variants. Otherwise the general ones serve until those are compiled.
    pub waits_for_kernels: bool,
    /// Settings of the surfel cache, for techniques that use it.
    pub surfel: SurfelSettings,
}

/// Why a technique cannot work here.
#[derive(Debug, thiserror::Error)]
pub enum TechniqueError {
    /// The device, a kernel or memory.
    #[error(transparent)]
    Gpu(#[from] GpuError),
    /// This scene or device lacks what the technique needs.
    #[error("technique {technique}: {reason}")]
    Unsupported {
        /// Technique id.
        technique: &'static str,
        /// What is missing.
        reason: String,
    },
}

/// A technique at work on one picture. Owns its history.
pub trait Technique: Send {
    /// Does the next piece of work and waits for it.
    fn step(
        &mut self,
        gpu: &Gpu,
        scene: &SceneBuffers,
        lights: &LightBuffers,
        view: &FrameView,
        budget: StepBudget,
    ) -> Result<Step, TechniqueError>;

    /// Forgets what no longer holds.
    fn invalidate(&mut self, change: Change);

    /// Gives its last frame away, for a picture of another size that takes its place; `None` where that has no use for it.
    fn leave_frame(&mut self) -> Option<EarlierFrame> {
        None
    }

    /// Takes the last frame of the picture that this one takes the place of, of the same view under the same lights.
    fn take_frame(&mut self, _earlier: EarlierFrame) {}

    /// Mean radiance (rgb) by pixel, unexposed; `vec4f`.
    fn picture(&self) -> &Buffer;

    /// Whole samples a pixel in the picture.
    fn samples(&self) -> u32;

    /// Direct light (bounced at most once) and B by pixel, where asked for.
    fn split(&self) -> Option<(&Buffer, &Buffer)>;

    /// Light over all lobes but the diffuse one by pixel, where asked for and kept apart.
    fn reflection(&self) -> Option<&Buffer> {
        None
    }

    /// The cache it draws on, to look into.
    fn surfel_cache(&self) -> Option<Arc<Mutex<SurfelCache>>> {
        None
    }

    /// Structural switches in use.
    fn features(&self) -> Features;

    /// Surfels in use and surfels that fit; `None` for techniques without any.
    fn surfels(&self) -> Option<[u32; 2]> {
        None
    }
}

/// Makes a technique for one picture.
pub type CreateTechnique = fn(
    &Gpu,
    &SceneBuffers,
    &LightBuffers,
    &SessionState,
    TechniqueOptions,
) -> Result<Box<dyn Technique>, TechniqueError>;

/// A technique on offer: one line of the registry.
#[derive(Clone, Copy)]
pub struct TechniqueEntry {
    /// Id on the command line and over HTTP.
    pub id: &'static str,
    /// Name for people.
    pub label: &'static str,
    /// One sentence.
    pub summary: &'static str,
    /// What is promised of a picture with these settings.
    pub conformance: fn(&SurfelSettings) -> Conformance,
    /// Kernels that a picture with these settings runs, for compilation ahead of use.
    pub kernels: fn(&SurfelSettings) -> Vec<&'static str>,
    /// Whether it draws on the surfel cache: presets, knobs and reconstruction mean nothing to others.
    pub uses_surfels: bool,
    /// Whether it can render a scene at all.
    pub needs: fn(&SceneSummary) -> Result<(), String>,
    /// Makes one.
    pub create: CreateTechnique,
}

impl std::fmt::Debug for TechniqueEntry {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("TechniqueEntry").field("id", &self.id).finish_non_exhaustive()
    }
}
