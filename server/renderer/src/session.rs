//! A session: a scene with its edited lights, and what its views share on the device.

use std::path::Path;
use std::sync::Arc;

use surfelcast_gpu::Gpu;
use surfelcast_render_api::Inspection;
use surfelcast_scene::{Camera, LightState, Scene, SceneEdit};
use surfelcast_techniques::{Change, FrameView, LightBuffers, SceneBuffers, SessionState, TechniqueEntry};

use crate::error::RendererError;
use crate::progressive::SceneOnDevice;
use crate::scenes::SceneStore;
use crate::snapshots;

/// One session of the actor.
pub(crate) struct Session {
    pub(crate) scene: Arc<Scene>,
    pub(crate) lights: LightState,
    /// Revision of what the session shows, returned in frames.
    pub(crate) scene_rev: u32,
    /// Scene and light table on the device; uploaded when first used.
    on_device: Option<(SceneBuffers, LightBuffers)>,
    /// What its views share.
    pub(crate) shared: SessionState,
}

impl Session {
    /// A session of a scene, with what techniques saved of it in `snapshots`.
    pub(crate) fn new(scene: Arc<Scene>, techniques: &'static [TechniqueEntry], snapshots: Option<&Path>) -> Self {
        let lights = LightState::of_scene(&scene);
        let shared = SessionState::default();
        if let Some(folder) = snapshots {
            snapshots::offer(folder, techniques, &scene, &lights, &shared);
        }
        Self { scene, lights, scene_rev: 0, on_device: None, shared }
    }

    /// Applies an edit; returns what techniques have to know of it.
    pub(crate) fn edit(&mut self, gpu: Option<&Gpu>, edit: SceneEdit, scene_rev: u32) -> Change {
        self.scene_rev = scene_rev;
        let change = match edit {
            SceneEdit::Lights(lights) => {
                self.lights = lights;
                self.upload_lights(gpu);
                Change::Lights
            }
        };
        self.shared.invalidate(change);
        change
    }

    /// Replaces the lights on the device, or drops what is there so that it is made again when next needed.
    fn upload_lights(&mut self, gpu: Option<&Gpu>) {
        if let Some(gpu) = gpu
            && let Some((_, buffers)) = &mut self.on_device
            && let Ok(new) = LightBuffers::new(gpu, &self.scene, &self.lights)
        {
            *buffers = new;
        } else {
            self.on_device = None;
        }
    }

    /// Scene and lights on the device, uploaded if need be, and what the session's views share.
    pub(crate) fn on_device<'a>(
        &'a mut self,
        gpu: &'a Gpu,
        store: &mut SceneStore,
    ) -> Result<(SceneOnDevice<'a>, &'a SessionState), RendererError> {
        let (scene, lights) = match &mut self.on_device {
            Some(on_device) => on_device,
            none => {
                let scene = store.get(gpu, &self.scene)?;
                let lights = LightBuffers::new(gpu, &self.scene, &self.lights)?;
                none.insert((scene, lights))
            }
        };
        Ok((SceneOnDevice { gpu, scene, lights }, &self.shared))
    }

    /// What a technique knows of the surface under a point of an image of that size.
    pub(crate) fn inspect(
        &mut self,
        gpu: &Gpu,
        store: &mut SceneStore,
        camera: Camera,
        size: [u32; 2],
        point: [f32; 2],
    ) -> Result<Option<Inspection>, RendererError> {
        let (on, shared) = self.on_device(gpu, store)?;
        let size = size.map(|side| side.max(1));
        let pixel = [0, 1].map(|axis| ((point[axis] * size[axis] as f32) as u32).min(size[axis] - 1));
        let view = FrameView { camera, size, exposure: 1.0 };
        for (_, part) in shared.parts() {
            if let Some(found) = part.inspect(gpu, on.scene, on.lights, &view, pixel)? {
                return Ok(Some(found));
            }
        }
        Ok(None)
    }

    /// The device is gone, and what was on it.
    pub(crate) fn forget_device(&mut self) {
        self.on_device = None;
        self.shared = SessionState::default();
    }

    /// Keeps the session's state for the next time its scene is opened.
    pub(crate) fn save(&self, gpu: &Gpu, snapshots: &Path) {
        snapshots::save(snapshots, gpu, &self.scene, &self.lights, &self.shared);
    }
}
