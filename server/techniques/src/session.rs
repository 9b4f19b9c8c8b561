//! What techniques keep for a whole session, shared by all its images.

use std::any::Any;
use std::collections::BTreeMap;
use std::sync::Arc;

use parking_lot::Mutex;
use surfelcast_gpu::Gpu;
use surfelcast_passes::frame::FrameView;
use surfelcast_passes::lights::LightBuffers;
use surfelcast_passes::upload::SceneBuffers;
use surfelcast_render_api::Inspection;

use crate::technique::{Change, TechniqueEntry, TechniqueError};

/// What a saved state belongs to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SnapshotIdentity {
    /// Hash of the scene.
    pub scene: [u8; 32],
    /// Hash of the lights.
    pub lights: [u8; 32],
}

/// What one technique keeps for a session.
pub trait TechniqueSession: Any + Send + Sync {
    /// Forgets what no longer holds.
    fn invalidate(&self, _change: Change) {}

    /// Explains the surface under a pixel of a view; `None` where nothing is hit or known.
    fn inspect(
        &self,
        _gpu: &Gpu,
        _scene: &SceneBuffers,
        _lights: &LightBuffers,
        _view: &FrameView,
        _pixel: [u32; 2],
    ) -> Result<Option<Inspection>, TechniqueError> {
        Ok(None)
    }

    /// Its state as bytes, to be kept over a restart; `None` where there is nothing to keep.
    fn save(&self, _gpu: &Gpu, _identity: &SnapshotIdentity) -> Result<Option<Vec<u8>>, TechniqueError> {
        Ok(None)
    }

    /// Takes saved bytes, to be used when the state is first needed. Those that do not fit are dropped with a warning.
    fn restore(&self, _identity: SnapshotIdentity, _bytes: Vec<u8>) {}

    /// The file that [`surfelcast_render_api::TechniqueDescription::export`] promises; `None` where there is nothing
    /// yet.
    fn export(&self, _gpu: &Gpu, _scene: &SceneBuffers) -> Result<Option<Vec<u8>>, TechniqueError> {
        Ok(None)
    }
}

/// Of techniques that keep nothing.
impl TechniqueSession for () {}

/// What a technique keeps, as its own type.
pub fn own<'a, T: TechniqueSession>(
    session: &'a dyn TechniqueSession,
    technique: &'static str,
) -> Result<&'a T, TechniqueError> {
    let session: &dyn Any = session;
    session.downcast_ref().ok_or_else(|| TechniqueError::Unsupported {
        technique,
        reason: "the session state is another technique's".to_owned(),
    })
}

/// State of a session next to its scene and lights. A batch render has one of its own.
#[derive(Default)]
pub struct SessionState {
    /// By technique id; made when first needed.
    parts: Mutex<BTreeMap<&'static str, Arc<dyn TechniqueSession>>>,
}

impl SessionState {
    /// What a technique keeps.
    pub fn of(&self, entry: &TechniqueEntry) -> Arc<dyn TechniqueSession> {
        Arc::clone(self.parts.lock().entry(entry.id()).or_insert_with(entry.open_session))
    }

    /// What the techniques keep that have been used so far, in the order of their ids.
    pub fn parts(&self) -> Vec<(&'static str, Arc<dyn TechniqueSession>)> {
        self.parts.lock().iter().map(|(id, part)| (*id, Arc::clone(part))).collect()
    }

    /// Forgets what no longer holds.
    pub fn invalidate(&self, change: Change) {
        for (_, part) in self.parts() {
            part.invalidate(change);
        }
    }
}

impl std::fmt::Debug for SessionState {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_set().entries(self.parts.lock().keys()).finish()
    }
}
