//! An interactive view: drives a technique as `refinement.rs` decides, and puts its frames into the slot.

use std::sync::Arc;
use std::time::Instant;

use surfelcast_gpu::PassTime;
use surfelcast_passes::first_surface;
use surfelcast_passes::merge_passes;
use surfelcast_passes::tone_map::tone_map;
use surfelcast_render_api::{ErrorEstimate, Settings, SkippedPass};
use surfelcast_shaders::Features;
use surfelcast_techniques::technique::{Change, TechniqueOptions};
use surfelcast_techniques::{
    Audit, FrameView, MaterialMode, OutputImage, SessionState, Technique, TechniqueEntry, registry,
};

use crate::audit_schedule::FIRST_AUDIT;
use crate::command::SessionKey;
use crate::error::RendererError;
use crate::progressive::{Progressive, SceneOnDevice};
use crate::refinement::Refinement;
use crate::running_job::{pass_times, skipped_passes, surface_output};
use crate::slot::FrameSlot;
use crate::throughput::Throughput;
use crate::view::{Frame, ViewState};

/// Largest factor of samples between audits.
const AUDIT_GROWTH: f64 = 2.0;
/// Seed of interactive images.
const SEED: u64 = 0;

/// The current image on the device: a technique with its history at one size.
struct Image {
    progressive: Progressive,
    technique_id: String,
    settings: Settings,
    size: [u32; 2],
}

/// One view.
pub(crate) struct RunningView {
    techniques: &'static [TechniqueEntry],
    pub(crate) session: SessionKey,
    pub(crate) slot: FrameSlot,
    /// Device time used, seconds.
    pub(crate) used_secs: f64,
    refinement: Refinement,
    image: Option<Image>,
    /// Estimate of the device's throughput, kept from image to image.
    throughput: Throughput,
    secs_since_frame: f64,
    passes: Vec<PassTime>,
    rays: u64,
}

impl RunningView {
    pub(crate) fn new(
        techniques: &'static [TechniqueEntry],
        session: SessionKey,
        state: ViewState,
        slot: FrameSlot,
        used_secs: f64,
    ) -> Self {
        Self {
            techniques,
            session,
            slot,
            used_secs,
            refinement: Refinement::new(state, Instant::now()),
            image: None,
            throughput: Throughput::default(),
            secs_since_frame: 0.0,
            passes: Vec::new(),
            rays: 0,
        }
    }

    /// Takes new view settings.
    pub(crate) fn update(&mut self, state: ViewState) {
        self.refinement.update(state);
    }

    /// Starts again after a change of what the session shows.
    pub(crate) fn invalidate(&mut self, change: Change) {
        self.refinement.discard();
        if let Some(image) = &mut self.image {
            image.progressive.technique_mut().invalidate(change);
        }
    }

    /// Drops what was on the lost device.
    pub(crate) fn forget_device(&mut self) {
        self.image = None;
        self.refinement.discard();
    }

    /// Whether the view is in a gesture.
    pub(crate) fn is_moving(&self) -> bool {
        self.refinement.is_moving()
    }

    /// Whether nothing is left to render or show.
    pub(crate) fn is_idle(&self) -> bool {
        self.refinement.is_idle()
    }

    /// Whether a step would do something now.
    pub(crate) fn wants_step(&self) -> bool {
        self.refinement.wants_step(self.samples(), self.slot.is_wanted(), self.throughput)
    }

    /// Rays since the last call.
    pub(crate) fn take_rays(&mut self) -> u64 {
        std::mem::take(&mut self.rays)
    }

    /// Samples a pixel of the current image, where there is one.
    fn samples(&self) -> Option<u32> {
        self.image.as_ref().map(|image| image.progressive.samples())
    }

    /// Does the next piece of work. Returns whether a frame was finished.
    pub(crate) fn step(
        &mut self,
        on: SceneOnDevice<'_>,
        session: &SessionState,
        scene_rev: u32,
    ) -> Result<bool, RendererError> {
        let started = Instant::now();
        let result = self.step_inner(on, session, scene_rev);
        let secs = started.elapsed().as_secs_f64();
        self.used_secs += secs;
        self.secs_since_frame += secs;
        let is_too_large = matches!(result, Err(RendererError::NoMemory { .. } | RendererError::SceneTooLarge { .. }));
        if is_too_large && self.refinement.shrink() {
            self.image = None;
            return Ok(false);
        }
        result
    }

    fn step_inner(
        &mut self,
        on: SceneOnDevice<'_>,
        session: &SessionState,
        scene_rev: u32,
    ) -> Result<bool, RendererError> {
        if self.refinement.begin_if_stale(self.image.is_some(), self.throughput)
            && let Some(image) = &mut self.image
        {
            image.progressive.restart();
        }
        if !self.refinement.is_converged() {
            self.prepare(on, session)?;
            self.trace(on)?;
            self.audit_if_due(on)?;
        }
        let Some(samples) = self.samples() else { return Ok(false) };
        if !self.refinement.is_shown(samples, self.slot.is_wanted(), Instant::now(), self.throughput) {
            return Ok(false);
        }
        self.show(on, scene_rev)?;
        Ok(true)
    }

    /// Creates the technique where its size or kind changed.
    fn prepare(&mut self, on: SceneOnDevice<'_>, session: &SessionState) -> Result<(), RendererError> {
        let size = self.refinement.render_size();
        let current = self.refinement.current();
        let has_lights = on.lights.punctual_count > 0;
        let fits = |image: &Image| {
            image.size == size
                && image.technique_id == current.technique
                && image.settings == current.settings
                && image.progressive.technique().features().contains(Features::PUNCTUAL_LIGHTS) == has_lights
        };
        if self.image.as_ref().is_some_and(fits) {
            return Ok(());
        }
        // The buffers of the old image are freed before those of the new one are allocated, except what it starts from.
        let earlier = self.image.take().and_then(|mut image| image.progressive.technique_mut().leave_frame());
        let (entry, settings) = registry::find(self.techniques, &current.technique)
            .ok_or_else(|| RendererError::Unsupported(format!("technique `{}` is not known", current.technique)))?;
        let options = TechniqueOptions {
            size,
            full_size: current.size,
            materials: MaterialMode::Pbr,
            is_split: false,
            seed: SEED,
            // Where kernels compile when they run, the general variant would only add its own time, and the change to
            // the fitting one would interrupt the image a second time.
            waits_for_kernels: on.gpu.compiles_when_run(),
            settings: settings.with(&current.settings),
        };
        let mut technique = entry.start(on.gpu, on.scene, on.lights, session, options)?;
        if let Some(earlier) = earlier {
            technique.take_frame(earlier);
        }
        self.image = Some(Image {
            progressive: Progressive::new(technique, self.throughput),
            technique_id: current.technique.clone(),
            settings: current.settings.clone(),
            size,
        });
        Ok(())
    }

    /// Takes samples where the current image lacks some.
    fn trace(&mut self, on: SceneOnDevice<'_>) -> Result<(), RendererError> {
        let Some(image) = &mut self.image else { return Ok(()) };
        let Image { progressive, size, .. } = image;
        let until = self.refinement.until(progressive.samples(), progressive.next_audit(), self.throughput);
        let Some(until) = until else { return Ok(()) };
        progressive.advance(on, &frame_view(self.refinement.current(), *size), until)?;
        self.throughput = progressive.throughput();
        self.collect_cost();
        Ok(())
    }

    /// Audits the image on its way to the goal, and once it is final.
    fn audit_if_due(&mut self, on: SceneOnDevice<'_>) -> Result<(), RendererError> {
        let Some(image) = &self.image else { return Ok(()) };
        let samples = image.progressive.samples();
        if self.refinement.is_audit_due(samples, image.progressive.next_audit()) {
            self.audit(on, false)?;
        }
        if self.refinement.is_final(samples) {
            if self.refinement.is_audit_outdated(samples) {
                self.audit(on, true)?;
            }
            self.refinement.converge();
        }
        Ok(())
    }

    /// Audits the image. `may_wait` for the kernel: otherwise an audit that is not compiled yet is left out.
    fn audit(&mut self, on: SceneOnDevice<'_>, may_wait: bool) -> Result<(), RendererError> {
        let Some(Image { progressive, size, .. }) = &mut self.image else { return Ok(()) };
        let features = progressive.technique().features();
        if !progressive.has_audit() {
            if !may_wait && !Audit::is_ready(on.gpu, features) {
                return Ok(());
            }
            progressive.set_audit(Audit::new(on.gpu, features, *size, SEED)?);
        }
        let current = self.refinement.current();
        let Some(found) = progressive.audit(on, &frame_view(current, *size))? else { return Ok(()) };
        progressive.plan_audit(found.bound, f64::from(current.max_error), AUDIT_GROWTH);
        self.refinement.audited(progressive.samples(), found.bound, ErrorEstimate::from(&found));
        progressive.cost_mut().add(found.rays, found.non_finite, found.passes);
        self.collect_cost();
        Ok(())
    }

    /// Moves the cost of the image to the view: a frame states the cost since the previous one, also of images given
    /// up.
    fn collect_cost(&mut self) {
        if let Some(image) = &mut self.image {
            let cost = std::mem::take(image.progressive.cost_mut());
            self.rays += cost.rays.iter().sum::<u64>();
            merge_passes(&mut self.passes, cost.passes);
        }
    }

    /// Tone-maps the image and puts it into the slot.
    fn show(&mut self, on: SceneOnDevice<'_>, scene_rev: u32) -> Result<(), RendererError> {
        let gpu = on.gpu;
        let Some(Image { progressive, size, .. }) = &self.image else { return Ok(()) };
        let current = self.refinement.current();
        let (technique, samples) = (progressive.technique(), progressive.samples());
        let [width, height] = *size;
        let view = frame_view(current, *size);
        let output = shown_output(on, &view, current.aov.as_deref(), technique)?;
        let (picture, exposure) = match &output {
            Some(output) if !output.is_light => (&output.buffer, 1.0),
            Some(output) => (&output.buffer, current.exposure),
            None => (technique.picture(), current.exposure),
        };
        let (pixels, mut passes) = tone_map(gpu, picture, width * height, exposure)?;
        if let Some(output) = output {
            merge_passes(&mut passes, output.passes);
        }
        merge_passes(&mut self.passes, passes);
        let error = self.refinement.error();
        let mut skipped = skipped_passes(technique.features(), false);
        if error.is_none() {
            let reason = format!("the picture has {samples} samples a pixel; audits start at {FIRST_AUDIT}");
            skipped.push(SkippedPass { name: "error_audit".to_owned(), reason });
        }
        let now = Instant::now();
        self.slot.put(Arc::new(Frame {
            pixels: pixels.into(),
            size: *size,
            full_size: current.size,
            kind: self.refinement.frame_kind(),
            input_seq: current.input_seq,
            scene_rev,
            samples,
            error,
            render_secs: self.secs_since_frame as f32,
            finished_at: now,
            passes: pass_times(&std::mem::take(&mut self.passes)),
            skipped,
        }));
        self.refinement.sent(samples, now);
        self.secs_since_frame = 0.0;
        Ok(())
    }
}

fn frame_view(settings: &ViewState, size: [u32; 2]) -> FrameView {
    FrameView { camera: settings.camera, size, exposure: settings.exposure }
}

/// What is shown instead of radiance, as colours that survive the tone map; none where the technique has no such
/// output.
fn shown_output(
    on: SceneOnDevice<'_>,
    view: &FrameView,
    aov: Option<&str>,
    technique: &dyn Technique,
) -> Result<Option<OutputImage>, RendererError> {
    let SceneOnDevice { gpu, scene, lights } = on;
    let Some(id) = aov else { return Ok(None) };
    let Some(output) = surface_output(aov) else {
        return Ok(technique.output(gpu, scene, lights, view, id, true)?);
    };
    let (buffer, passes) =
        first_surface::first_surface_for_screen(gpu, scene, lights, view, MaterialMode::Pbr, output)?;
    Ok(Some(OutputImage { buffer, passes, is_light: false }))
}
