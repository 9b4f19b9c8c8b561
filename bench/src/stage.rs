//! Drives a technique on a scene and counts what it costs.
//!
//! The actor of the server schedules jobs and delivers finished images. Here an image is observed while samples
//! accumulate, its cache may have been used by another camera before, and nothing else runs, so techniques are
//! stepped directly, with the same step budgets.

use surfelcast::Failure;
use surfelcast_gpu::{Buffer, Gpu};
use surfelcast_measure::{Image, Mode};
use surfelcast_render_api::Settings;
use surfelcast_renderer::Throughput;
use surfelcast_renderer::progressive::{Cost, MAX_JOB_BATCH, Progressive, SceneOnDevice, Until};
use surfelcast_scene::{Camera, Scene};
use surfelcast_techniques::technique::TechniqueOptions;
use surfelcast_techniques::{
    Audit, AuditResult, FrameView, LightBuffers, LightState, MaterialMode, SceneBuffers, SessionState, TECHNIQUES,
    registry,
};

/// A scene on the device, and how images of it are made.
pub(crate) struct Stage<'a> {
    pub(crate) gpu: &'a Gpu,
    pub(crate) scene: &'a Scene,
    buffers: SceneBuffers,
    lights: LightBuffers,
    pub(crate) mode: Mode,
    pub(crate) size: [u32; 2],
    pub(crate) exposure: f32,
}

/// An image that accumulates samples.
pub(crate) struct Shot<'a> {
    stage: &'a Stage<'a>,
    progressive: Progressive,
    view: FrameView,
}

impl<'a> Stage<'a> {
    pub(crate) fn new(
        gpu: &'a Gpu,
        scene: &'a Scene,
        mode: Mode,
        size: [u32; 2],
        exposure: f32,
    ) -> Result<Self, Failure> {
        let buffers = SceneBuffers::new(gpu, scene)?;
        let lights = LightBuffers::new(gpu, scene, &LightState::of_scene(scene))?;
        Ok(Self { gpu, scene, buffers, lights, mode, size, exposure })
    }

    /// A new image, on a session's cache.
    pub(crate) fn shot(
        &'a self,
        technique: &str,
        settings: &Settings,
        camera: Camera,
        seed: u64,
        session: &SessionState,
    ) -> Result<Shot<'a>, Failure> {
        let (entry, defaults) = registry::find(TECHNIQUES, technique)
            .ok_or_else(|| Failure::input(format!("--technique {technique}: there is no such technique")))?;
        (entry.needs)(&self.scene.summary).map_err(Failure::input)?;
        let options = TechniqueOptions {
            size: self.size,
            full_size: self.size,
            materials: if self.mode == Mode::Pbr { MaterialMode::Pbr } else { MaterialMode::Lambert },
            is_split: self.mode == Mode::Indirect,
            seed,
            waits_for_kernels: true,
            settings: defaults.with(settings),
        };
        let technique = entry.start(self.gpu, &self.buffers, &self.lights, session, options)?;
        let features = technique.features();
        let mut progressive = Progressive::new(technique, Throughput::default());
        // The audit judges radiance.
        if self.mode != Mode::Indirect {
            progressive.set_audit(Audit::new(self.gpu, features, self.size, seed)?);
        }
        let view = FrameView { camera, size: self.size, exposure: self.exposure };
        Ok(Shot { stage: self, progressive, view })
    }

    fn on_device(&self) -> SceneOnDevice<'_> {
        SceneOnDevice { gpu: self.gpu, scene: &self.buffers, lights: &self.lights }
    }
}

impl Shot<'_> {
    /// Renders until the image has `samples` per pixel or has cost `limit_secs`. Returns whether it has the samples.
    pub(crate) fn render(&mut self, samples: u32, limit_secs: f64) -> Result<bool, Failure> {
        let until = Until { samples, max_batch: MAX_JOB_BATCH };
        while self.progressive.samples() < samples {
            if self.cost().secs >= limit_secs {
                return Ok(false);
            }
            self.progressive.advance(self.stage.on_device(), &self.view, until)?;
        }
        Ok(true)
    }

    /// What the image has cost so far, without reading it back and without audits.
    pub(crate) fn cost(&self) -> &Cost {
        self.progressive.cost()
    }

    /// The current image, in the stage's mode.
    pub(crate) fn image(&self) -> Result<Image, Failure> {
        let buffer = match (self.stage.mode, self.progressive.technique().split()) {
            (Mode::Indirect, Some((_, irradiance))) => irradiance,
            (Mode::Indirect, None) => return Err(Failure::input("the technique does not keep indirect light apart")),
            _ => self.progressive.technique().picture(),
        };
        let pixels =
            read_pixels(self.stage.gpu, buffer)?.iter().map(|&[r, g, b, _]| [r, g, b].map(f64::from)).collect();
        Ok(Image { size: self.stage.size.map(|side| side as usize), pixels })
    }

    /// The renderer's own estimate of the error; nothing for outputs other than radiance.
    pub(crate) fn audit(&mut self) -> Result<Option<AuditResult>, Failure> {
        Ok(self.progressive.audit(self.stage.on_device(), &self.view)?)
    }

    /// Live surfels, for techniques with surfels.
    pub(crate) fn surfels(&self) -> Option<u32> {
        self.progressive.technique().occupancy().map(|[live, _]| live)
    }
}

/// Reads a buffer of pixels back.
pub(crate) fn read_pixels(gpu: &Gpu, buffer: &Buffer) -> Result<Vec<[f32; 4]>, Failure> {
    let mut graph = gpu.graph("read_back");
    let ticket = graph.read_back(buffer, 0..buffer.size_bytes())?;
    let bytes = graph.submit()?.wait()?.take(ticket)?;
    Ok(bytemuck::pod_collect_to_vec(&bytes))
}

/// Rotations of a camera about its target, degrees; the first unobstructed one is taken.
const ASIDE_DEGREES: [f64; 8] = [15.0, -15.0, 10.0, -10.0, 6.0, -6.0, 3.0, -3.0];
/// Rotation in place if all of them are obstructed, degrees.
const TURN_DEGREES: f64 = 10.0;

/// A camera that sees mostly the same surfaces from another place: rotated about the surface in the middle of the
/// image.
pub(crate) fn camera_aside(scene: &Scene, camera: &Camera) -> Camera {
    let (_, up, forward) = camera.frame();
    let local = |position: glam::DVec3| (position - scene.origin).as_vec3();
    let hit = |origin, direction: glam::DVec3, most| {
        surfelcast_scene::trace::closest_hit(&scene.geometry, local(origin), direction.as_vec3(), 0.0, most)
    };
    if let Some(ahead) = hit(camera.position, forward, f32::MAX) {
        let focus = camera.position + forward * f64::from(ahead.t);
        let arm = camera.position - focus;
        for degrees in ASIDE_DEGREES {
            let position = focus + glam::DQuat::from_axis_angle(up, degrees.to_radians()) * arm;
            let moved = Camera { position, target: focus, ..*camera };
            // Both the way there and the view from there are unobstructed, so that the camera is not inside a wall.
            let step = position - camera.position;
            if hit(position, focus - position, 0.98).is_none() && hit(camera.position, step, 1.05).is_none() {
                return moved;
            }
        }
    }
    let turned = glam::DQuat::from_axis_angle(up, TURN_DEGREES.to_radians()) * forward;
    Camera { target: camera.position + turned, ..*camera }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_camera_aside_sees_the_same_place_from_elsewhere() {
        let scene = surfelcast::scene_file::load(std::path::Path::new("demo:cornell_box"), None, None).unwrap();
        for named in &scene.cameras {
            let aside = camera_aside(&scene, &named.camera);
            assert!(aside.is_valid() && aside.position != named.camera.position, "{}", named.name);
            let toward = aside.target - aside.position;
            let hit = surfelcast_scene::trace::closest_hit(
                &scene.geometry,
                (aside.position - scene.origin).as_vec3(),
                toward.as_vec3(),
                0.0,
                2.0,
            );
            assert!(hit.is_some_and(|hit| (hit.t - 1.0).abs() < 0.02), "{}: {hit:?}", named.name);
            let (_, _, forward) = named.camera.frame();
            assert!(toward.normalize_or(forward).dot(forward) > 0.95, "{}", named.name);
        }
        // Without a surface in the middle the camera turns in place.
        let away = Camera { target: scene.cameras[0].camera.position + glam::DVec3::Z, ..scene.cameras[0].camera };
        let turned = camera_aside(&scene, &away);
        assert!(turned.position == away.position && turned.target != away.target);
    }
}
