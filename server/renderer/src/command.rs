//! Commands to the render actor.

use std::sync::Arc;

use surfelcast_scene::{Camera, Picked, Scene, SceneEdit};
use tokio::sync::{mpsc, oneshot, watch};

use crate::error::RendererError;
use crate::inspection::Inspection;
use crate::job::{JobProgress, RenderJob, RenderOutput};
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

/// Answer channel of a command.
pub type Reply<T> = oneshot::Sender<Result<T, RendererError>>;

/// Everything the actor can be told.
#[derive(Debug)]
pub enum Command {
    /// Make a session of a scene. Admission is by estimated bytes before anything is uploaded.
    OpenSession {
        /// Chosen by the handle.
        session: SessionKey,
        /// Scene.
        scene: Arc<Scene>,
        /// Answer.
        reply: Reply<()>,
    },
    /// Drop a session and its views.
    CloseSession {
        /// Session.
        session: SessionKey,
    },
    /// Change what a session shows; every view of it starts again. `scene_rev` comes back in the frames.
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
    /// Find the surface under a point of a picture.
    Pick {
        /// Session.
        session: SessionKey,
        /// Camera of the picture.
        camera: Camera,
        /// Width over height of the picture.
        aspect: f64,
        /// Position in the picture, 0 to 1 from the top left.
        point: [f32; 2],
        /// Answer.
        reply: Reply<Option<Picked>>,
    },
    /// Find the surfels that light the surface under a point of a picture.
    Inspect {
        /// Session.
        session: SessionKey,
        /// Camera of the picture.
        camera: Camera,
        /// Size of the picture, pixels.
        size: [u32; 2],
        /// Position in the picture, 0 to 1 from the top left.
        point: [f32; 2],
        /// Answer; nothing where no surface is hit or the session keeps no surfels.
        reply: Reply<Option<Inspection>>,
    },
    /// Render one picture in the background.
    Render {
        /// The job.
        job: Box<RenderJob>,
        /// Progress; dropping all receivers does not cancel.
        progress: watch::Sender<JobProgress>,
        /// Set to true to cancel; the answer is then what was done so far, or [`RendererError::Canceled`].
        cancel: watch::Receiver<bool>,
        /// Answer.
        reply: Reply<RenderOutput>,
    },
    /// A slot became wanted; look at the views again.
    Wake,
    /// Lose the device on purpose (tests only, guarded by configuration).
    LoseDevice,
    /// Finish the frame in hand and stop.
    Stop,
}
