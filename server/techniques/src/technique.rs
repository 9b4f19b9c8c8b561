//! The contract between a technique and whoever runs it.

use std::any::Any;
use std::sync::Arc;

use surfelcast_gpu::{Buffer, Gpu, GpuError, PassTime};
use surfelcast_passes::frame::FrameView;
use surfelcast_passes::lights::LightBuffers;
use surfelcast_passes::materials::MaterialMode;
use surfelcast_passes::step::{Step, StepBudget};
use surfelcast_passes::upload::SceneBuffers;
use surfelcast_render_api::{Settings, TechniqueDescription};
use surfelcast_scene::SceneSummary;
use surfelcast_shaders::Features;

use crate::session::{SessionState, TechniqueSession};

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

/// What is promised about a technique's image; tests hold it to that.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Conformance {
    /// The expected image is the truth at any number of samples.
    Unbiased,
    /// The image converges to the truth.
    Consistent,
    /// The image converges to within this tone-mapped RMSE of the truth.
    Biased {
        /// Bound.
        rmse_tonemapped: f32,
    },
}

/// What a technique is made with.
#[derive(Clone, Debug, PartialEq)]
pub struct TechniqueOptions {
    /// Image size in pixels.
    pub size: [u32; 2],
    /// Size at which it is shown: images of a gesture are smaller, and what a session keeps must not follow that.
    pub full_size: [u32; 2],
    /// Materials.
    pub materials: MaterialMode,
    /// Direct and indirect light are kept apart too.
    pub is_split: bool,
    /// Seed of all random numbers.
    pub seed: u64,
    /// Whether to wait for the kernels' special variants. Otherwise the general ones serve until those are compiled.
    pub waits_for_kernels: bool,
    /// Values of the technique's settings; one that is missing is at its default.
    pub settings: Settings,
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

/// The last frame of a technique, opaque to whoever hands it on.
pub type EarlierFrame = Box<dyn Any + Send>;

/// One of a technique's own outputs.
#[derive(Debug)]
pub struct OutputImage {
    /// `vec4f` by pixel.
    pub buffer: Buffer,
    /// Passes that made it.
    pub passes: Vec<PassTime>,
    /// Whether it holds light, which a view shows at its exposure.
    pub is_light: bool,
}

/// A technique at work on one image. Owns its history.
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

    /// Gives its last frame away, for an image of another size that takes its place; `None` where that has no use for
    /// it.
    fn leave_frame(&mut self) -> Option<EarlierFrame> {
        None
    }

    /// Takes the last frame of the image whose place this one takes, of the same view under the same lights. A frame of
    /// another technique is of no use and dropped.
    fn take_frame(&mut self, _earlier: EarlierFrame) {}

    /// Mean radiance (rgb) by pixel, unexposed; `vec4f`.
    fn picture(&self) -> &Buffer;

    /// Whole samples a pixel in the image.
    fn samples(&self) -> u32;

    /// Direct light (bounced at most once) and indirect irradiance over pi by pixel, where they are kept apart.
    fn split(&self) -> Option<(&Buffer, &Buffer)>;

    /// One of the outputs in [`TechniqueDescription::outputs`]; `is_shown` for colours that survive the tone map
    /// instead of numbers.
    fn output(
        &self,
        _gpu: &Gpu,
        _scene: &SceneBuffers,
        _lights: &LightBuffers,
        _view: &FrameView,
        _id: &str,
        _is_shown: bool,
    ) -> Result<Option<OutputImage>, TechniqueError> {
        Ok(None)
    }

    /// Structural switches in use.
    fn features(&self) -> Features;

    /// Entries of its cache in use and entries that fit; `None` for techniques without one.
    fn occupancy(&self) -> Option<[u32; 2]> {
        None
    }
}

/// Makes a technique for one image, with what it keeps for the session.
pub type CreateTechnique = fn(
    &Gpu,
    &SceneBuffers,
    &LightBuffers,
    &dyn TechniqueSession,
    TechniqueOptions,
) -> Result<Box<dyn Technique>, TechniqueError>;

/// A technique on offer: one line of the registry.
#[derive(Clone, Copy)]
pub struct TechniqueEntry {
    /// What can be requested of it.
    pub description: TechniqueDescription,
    /// What is promised of an image with these settings.
    pub conformance: fn(&Settings) -> Conformance,
    /// Kernels that an image with these settings runs, for compilation ahead of use.
    pub kernels: fn(&Settings) -> Vec<&'static str>,
    /// Whether it can render a scene at all.
    pub needs: fn(&SceneSummary) -> Result<(), String>,
    /// Makes one; see [`TechniqueEntry::start`].
    pub create: CreateTechnique,
    /// Makes what it keeps for a session: `|| Arc::new(())` where that is nothing.
    pub open_session: fn() -> Arc<dyn TechniqueSession>,
}

impl TechniqueEntry {
    /// Id on the command line and over HTTP.
    pub fn id(&self) -> &'static str {
        self.description.id
    }

    /// Makes one for an image of a session.
    pub fn start(
        &self,
        gpu: &Gpu,
        scene: &SceneBuffers,
        lights: &LightBuffers,
        session: &SessionState,
        options: TechniqueOptions,
    ) -> Result<Box<dyn Technique>, TechniqueError> {
        (self.create)(gpu, scene, lights, session.of(self).as_ref(), options)
    }
}

impl std::fmt::Debug for TechniqueEntry {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("TechniqueEntry").field("id", &self.id()).finish_non_exhaustive()
    }
}
