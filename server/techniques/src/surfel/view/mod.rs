//! One view of a cache: an image that gathers its indirect light from the surfels. Its frames are in `frame.rs`.

mod budget;
mod image;
mod inspect;
mod splat;

use std::sync::Arc;

use parking_lot::Mutex;
use surfelcast_gpu::{Buffer, Gpu, GpuError, MemoryKind};
use surfelcast_passes::counters;
use surfelcast_passes::direct_light::{DirectLight, DirectLightOptions};
use surfelcast_passes::features::{features_for, general_features};
use surfelcast_passes::frame::FrameView;
use surfelcast_passes::kernels::KernelSet;
use surfelcast_passes::lights::LightBuffers;
use surfelcast_passes::settling::{Settling, SettlingOptions};
use surfelcast_passes::step::{Step, StepBudget};
use surfelcast_passes::upload::SceneBuffers;
use surfelcast_passes::visibility::Visibility;
use surfelcast_shaders::Features;

pub(super) use self::budget::{Budget, UpdateChoice};
pub(super) use self::image::{Gathered, ImageReconstruction};
pub use self::inspect::SurfelOutput;
pub(super) use self::splat::{SPLAT, Splat};
use crate::surfel::cache::SurfelCache;
use crate::surfel::frame::Stage;
use crate::surfel::outputs::{REFLECTION, seen_by_id};
use crate::surfel::session::SurfelSession;
use crate::surfel::{ViewOptions, kernels_for};
use crate::technique::{Change, EarlierFrame, OutputImage, Technique, TechniqueError};

/// Kernels of the reconstruction in the image.
pub(super) use self::image::KERNELS as IMAGE_KERNELS;

/// A view with what it has accumulated.
pub(super) struct SurfelView {
    pub(super) options: ViewOptions,
    pub(super) kernels: KernelSet,
    pub(super) cache: Arc<Mutex<SurfelCache>>,
    /// Number of the view's camera in the cache.
    pub(super) camera: u64,
    pub(super) budget: Budget,
    /// The cache's update that the view has seen last.
    pub(super) seen_update: u32,
    pub(super) stage: Stage,
    /// Frames accumulated.
    pub(super) frames: u32,
    /// Samples per pixel accumulated.
    pub(super) samples: u32,
    /// Further samples per pixel that the current frame takes.
    pub(super) samples_left: u32,
    /// Rays of the current frame.
    pub(super) frame_rays: u64,
    /// Path-traced samples that the image converges to.
    pub(super) settling: Option<Settling>,
    pub(super) visibility: Visibility,
    /// Mean radiance (rgb), `vec4f` by pixel.
    pub(super) accumulation: Buffer,
    /// Mean light that was scattered at most once, `vec4f` by pixel.
    pub(super) direct: Buffer,
    /// Reuse and filter of direct light.
    pub(super) light: DirectLight,
    /// Where surfels are drawn instead of gathered.
    pub(super) splat: Option<Splat>,
    /// Irradiance over pi and reflections, where the image is split.
    pub(super) split: Option<(Buffer, Buffer)>,
    /// Where light is reconstructed in the image.
    pub(super) image: Option<ImageReconstruction>,
    pub(super) counters: Buffer,
}

impl SurfelView {
    pub(super) fn new(
        gpu: &Gpu,
        scene: &SceneBuffers,
        lights: &LightBuffers,
        session: &SurfelSession,
        options: ViewOptions,
    ) -> Result<Self, GpuError> {
        let splat = Splat::new(gpu, options.surfel.apply, options.size)?;
        let features = features_for(&scene.summary, options.materials, lights.punctual_count > 0, options.is_split)
            .with(SPLAT, splat.is_some());
        let general = general_features(options.materials, options.is_split).with(SPLAT, splat.is_some());
        let kernels = KernelSet::new(gpu, kernels_for(&options.surfel), features, general, options.waits_for_kernels)?;
        let pixels = u64::from(options.size[0]) * u64::from(options.size[1]);
        let view_buffer = |label| gpu.buffer(label, MemoryKind::View, pixels * 16);
        let cache = session.cache(gpu, scene, &options)?;
        let camera = cache.lock().add_camera(options.surfel.pins);
        let radius_pixels = options.surfel.radius_pixels;
        Ok(Self {
            kernels,
            cache,
            camera,
            budget: Budget::new(options.size, options.full_size[1], radius_pixels, options.surfel.rays_per_pixel),
            seen_update: 0,
            stage: Stage::Start,
            frames: 0,
            samples: 0,
            samples_left: 0,
            frame_rays: 0,
            // What is split apart is the cache's alone.
            settling: (options.surfel.settles && !options.is_split).then(|| {
                Settling::new(SettlingOptions {
                    size: options.size,
                    materials: options.materials,
                    features: features.with(SPLAT, false),
                    seed: options.seed,
                    waits_for_kernels: options.waits_for_kernels,
                })
            }),
            visibility: Visibility::new(gpu, options.size)?,
            accumulation: view_buffer("accumulation")?,
            direct: view_buffer("direct_mean")?,
            light: DirectLight::new(
                gpu,
                DirectLightOptions {
                    size: options.size,
                    // What is split apart is shown as it was sampled.
                    reuses: options.surfel.reuses_direct && !options.is_split,
                    filters: options.surfel.filters_direct && !options.is_split,
                    is_moving: options.size != options.full_size,
                },
            )?,
            splat,
            split: if options.is_split {
                Some((view_buffer("split_irradiance")?, view_buffer("split_reflection")?))
            } else {
                None
            },
            image: ImageReconstruction::new(gpu, &options)?,
            counters: counters::buffer(gpu)?,
            options,
        })
    }

    pub(super) fn pixel_count(&self) -> u32 {
        self.options.size[0] * self.options.size[1]
    }

    /// The image that the cache's frames make, without the path-traced one.
    pub(super) fn cache_image(&self) -> &Buffer {
        let gathered = || self.light.image().unwrap_or(&self.accumulation);
        self.image.as_ref().map_or_else(gathered, ImageReconstruction::image)
    }
}

impl Technique for SurfelView {
    fn step(
        &mut self,
        gpu: &Gpu,
        scene: &SceneBuffers,
        lights: &LightBuffers,
        view: &FrameView,
        budget: StepBudget,
    ) -> Result<Step, TechniqueError> {
        self.advance(gpu, scene, lights, view, budget)
    }

    fn invalidate(&mut self, change: Change) {
        match change {
            Change::Camera => self.light.move_camera(self.frames),
            // The cache belongs to the session, which announces such a change to it once.
            Change::Lights | Change::Transforms => self.light.relight(),
        }
        if let Some(settling) = &mut self.settling {
            settling.restart();
        }
        if let Some(image) = &mut self.image {
            image.restart();
        }
        self.frames = 0;
        self.samples = 0;
        self.samples_left = 0;
        self.frame_rays = 0;
        self.stage = Stage::Start;
    }

    fn leave_frame(&mut self) -> Option<EarlierFrame> {
        self.light.leave().map(|frame| -> EarlierFrame { Box::new(frame) })
    }

    fn take_frame(&mut self, earlier: EarlierFrame) {
        if let Ok(earlier) = earlier.downcast() {
            self.light.take(*earlier);
        }
    }

    fn picture(&self) -> &Buffer {
        let settled = self.settling.as_ref().and_then(Settling::image);
        settled.unwrap_or_else(|| self.cache_image())
    }

    fn samples(&self) -> u32 {
        self.frames + self.settling.as_ref().map_or(0, Settling::counted)
    }

    fn split(&self) -> Option<(&Buffer, &Buffer)> {
        let reconstructed = self.image.as_ref().and_then(ImageReconstruction::irradiance);
        self.split.as_ref().map(|(irradiance, _)| (&self.direct, reconstructed.unwrap_or(irradiance)))
    }

    fn output(
        &self,
        gpu: &Gpu,
        scene: &SceneBuffers,
        lights: &LightBuffers,
        view: &FrameView,
        id: &str,
        is_shown: bool,
    ) -> Result<Option<OutputImage>, TechniqueError> {
        if id == REFLECTION {
            let reflection = self.split.as_ref().map(|(_, reflection)| reflection.clone());
            return Ok(reflection.map(|buffer| OutputImage { buffer, passes: Vec::new(), is_light: true }));
        }
        let Some(output) = seen_by_id(id) else { return Ok(None) };
        let features = self.kernels.features();
        let (buffer, passes) = self.cache.lock().look(gpu, scene, lights, view, features, output, is_shown)?;
        Ok(Some(OutputImage { buffer, passes, is_light: output == SurfelOutput::Irradiance }))
    }

    fn features(&self) -> Features {
        self.kernels.features()
    }

    fn occupancy(&self) -> Option<[u32; 2]> {
        Some(self.cache.lock().counts())
    }
}

impl Drop for SurfelView {
    fn drop(&mut self) {
        self.cache.lock().remove_camera(self.camera);
    }
}
