//! Commands to the render actor.

use std::sync::Arc;

use surfelcast_render_api::{Inspection, JobProgress, RenderOutput};
use surfelcast_scene::{Camera, Picked, Scene, SceneEdit};
use tokio::sync::{mpsc, oneshot, watch};

use crate::error::RendererError;
use crate::job::RenderJob;
use crate::slot::FrameSlot;
use crate::view::ViewState;

/// Names a session inside the renderer.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct SessionKey(pub u64);

/// Names a view inside the renderer.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct ViewKey(pub u64);

/// The receiving end of the command channel.
pub type CommandReceiver = mpsc::Receiver<Command>;

/// Channel for the answer to a command.
pub type Reply<T> = oneshot::Sender<Result<T, RendererError>>;

/// Requests to the actor.
#[derive(Debug)]
pub enum Command {
    /// Open a session of a scene. It is admitted by its estimated bytes before anything is uploaded.
    OpenSession {
        /// Chosen by the handle.
        session: SessionKey,
        /// Scene.
        scene: Arc<Scene>,
        /// Answer.
        reply: Reply<()>,
    },
    /// Close a session and its views.
    CloseSession {
        /// Session.
        session: SessionKey,
    },
    /// Change what a session shows; all its views start again. `scene_rev` is returned in their frames.
    EditScene {
        /// Session.
        session: SessionKey,
        /// The change.
        edit: SceneEdit,
        /// Revision after the change.
        scene_rev: u32,
    },
    /// Open a view.
    OpenView {
        /// Session.
        session: SessionKey,
        /// Chosen by the handle.
        view: ViewKey,
        /// First state.
        state: ViewState,
        /// Where frames go.
        slot: FrameSlot,
        /// Answer.
        reply: Reply<()>,
    },
    /// Replace the state of a view.
    UpdateView {
        /// View.
        view: ViewKey,
        /// New state.
        state: Box<ViewState>,
    },
    /// Close a view.
    CloseView {
        /// View.
        view: ViewKey,
    },
    /// Find the surface under a point of an image.
    Pick {
        /// Session.
        session: SessionKey,
        /// Camera of the image.
        camera: Camera,
        /// Width over height of the image.
        aspect: f64,
        /// Position in the image, 0 to 1 from the top left.
        point: [f32; 2],
        /// Answer.
        reply: Reply<Option<Picked>>,
    },
    /// Explain the surface under a point of an image.
    Inspect {
        /// Session.
        session: SessionKey,
        /// Camera of the image.
        camera: Camera,
        /// Size of the image, pixels.
        size: [u32; 2],
        /// Position in the image, 0 to 1 from the top left.
        point: [f32; 2],
        /// Answer; nothing where no surface is hit or no technique of the session knows of it.
        reply: Reply<Option<Inspection>>,
    },
    /// Render one image in the background.
    Render {
        /// The job.
        job: Box<RenderJob>,
        /// Progress; dropping all receivers does not cancel.
        progress: watch::Sender<JobProgress>,
        /// Set to true to cancel; the answer is then the image so far, or [`RendererError::Canceled`].
        cancel: watch::Receiver<bool>,
        /// Answer.
        reply: Reply<RenderOutput>,
    },
    /// A slot became wanted: check the views again.
    Wake,
    /// Lose the device on purpose (tests only, guarded by configuration).
    LoseDevice,
    /// Finish the current step and stop.
    Stop,
}
