//! A session: a scene with its edited lights, and what its views share on the device.

use std::path::Path;
use std::sync::Arc;

use surfelcast_gpu::Gpu;
use surfelcast_scene::{LightState, Scene, SceneEdit};
use surfelcast_techniques::{Change, LightBuffers, SceneBuffers, SessionState};

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
    on_device: Option<(Arc<SceneBuffers>, LightBuffers)>,
    /// What its views share.
    pub(crate) shared: SessionState,
}

impl Session {
    /// A session of a scene, with the surfels that an earlier one saved in `snapshots`.
    pub(crate) fn new(scene: Arc<Scene>, snapshots: Option<&Path>) -> Self {
        let lights = LightState::of_scene(&scene);
        let shared = SessionState::default();
        if let Some(folder) = snapshots {
            snapshots::offer(folder, &scene, &lights, &shared);
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

    /// Scene and lights on the device, uploaded if necessary, and what the session's views share.
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

    /// Drops what was on the lost device.
    pub(crate) fn forget_device(&mut self) {
        self.on_device = None;
        self.shared = SessionState::default();
    }

    /// Saves the session's surfels for the next session of its scene.
    pub(crate) fn save(&self, gpu: &Gpu, snapshots: &Path) {
        snapshots::save(snapshots, gpu, &self.scene, &self.lights, &self.shared);
    }
}
