//! Handle of the render actor for other threads.

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use surfelcast_render_api::{Inspection, JobProgress, RenderOutput};
use surfelcast_scene::{Camera, Picked, Scene, SceneEdit};
use tokio::sync::{mpsc, oneshot, watch};

use crate::command::{Command, CommandReceiver, SessionKey, ViewKey};
use crate::error::RendererError;
use crate::job::RenderJob;
use crate::slot::FrameSlot;
use crate::status::RendererStatus;
use crate::view::ViewState;

/// Commands that may wait.
const COMMAND_CAPACITY: usize = 256;

/// Sends commands to the actor. Cheap to clone.
#[derive(Clone, Debug)]
pub struct RendererHandle {
    commands: mpsc::Sender<Command>,
    status: watch::Receiver<RendererStatus>,
    next_key: Arc<AtomicU64>,
}

/// A running job.
#[derive(Debug)]
pub struct JobTicket {
    /// Progress.
    pub progress: watch::Receiver<JobProgress>,
    /// Send `true` to cancel.
    pub cancel: watch::Sender<bool>,
    /// The result.
    pub result: oneshot::Receiver<Result<RenderOutput, RendererError>>,
}

impl RendererHandle {
    /// A handle, and the channel ends of the actor (or of a test's stand-in).
    pub fn channel() -> (Self, CommandReceiver, watch::Sender<RendererStatus>) {
        let (commands, receiver) = mpsc::channel(COMMAND_CAPACITY);
        let (status_sender, status) = watch::channel(RendererStatus::default());
        (Self { commands, status, next_key: Arc::new(AtomicU64::new(1)) }, receiver, status_sender)
    }

    /// Current state of the renderer; can be awaited for changes.
    pub fn status(&self) -> watch::Receiver<RendererStatus> {
        self.status.clone()
    }

    /// Opens a session of a scene.
    pub async fn open_session(&self, scene: Arc<Scene>) -> Result<SessionKey, RendererError> {
        let session = SessionKey(self.key());
        self.ask(|reply| Command::OpenSession { session, scene, reply }).await?;
        Ok(session)
    }

    /// Closes a session with its views.
    pub async fn close_session(&self, session: SessionKey) -> Result<(), RendererError> {
        self.send(Command::CloseSession { session }).await
    }

    /// Changes what a session shows.
    pub async fn edit_scene(&self, session: SessionKey, edit: SceneEdit, scene_rev: u32) -> Result<(), RendererError> {
        self.send(Command::EditScene { session, edit, scene_rev }).await
    }

    /// Opens a view; frames arrive in `slot` while one is wanted.
    pub async fn open_view(
        &self,
        session: SessionKey,
        state: ViewState,
        slot: FrameSlot,
    ) -> Result<ViewKey, RendererError> {
        let view = ViewKey(self.key());
        self.ask(|reply| Command::OpenView { session, view, state, slot, reply }).await?;
        Ok(view)
    }

    /// Replaces a view's state.
    pub async fn update_view(&self, view: ViewKey, state: ViewState) -> Result<(), RendererError> {
        self.send(Command::UpdateView { view, state: Box::new(state) }).await
    }

    /// Closes a view.
    pub async fn close_view(&self, view: ViewKey) -> Result<(), RendererError> {
        self.send(Command::CloseView { view }).await
    }

    /// Finds the surface under a point of an image.
    pub async fn pick(
        &self,
        session: SessionKey,
        camera: Camera,
        aspect: f64,
        point: [f32; 2],
    ) -> Result<Option<Picked>, RendererError> {
        self.ask(|reply| Command::Pick { session, camera, aspect, point, reply }).await
    }

    /// Explains the surface under a point of an image, by what a technique of the session knows of it.
    pub async fn inspect(
        &self,
        session: SessionKey,
        camera: Camera,
        size: [u32; 2],
        point: [f32; 2],
    ) -> Result<Option<Inspection>, RendererError> {
        self.ask(|reply| Command::Inspect { session, camera, size, point, reply }).await
    }

    /// Starts a job; fails at once with [`RendererError::Busy`] when the command queue is full.
    pub fn render(&self, job: RenderJob) -> Result<JobTicket, RendererError> {
        let (progress_sender, progress) = watch::channel(JobProgress::default());
        let (cancel, cancel_receiver) = watch::channel(false);
        let (reply, result) = oneshot::channel();
        let command = Command::Render { job: Box::new(job), progress: progress_sender, cancel: cancel_receiver, reply };
        self.commands.try_send(command).map_err(|error| match error {
            mpsc::error::TrySendError::Full(_) => RendererError::Busy { what: "commands", limit: COMMAND_CAPACITY },
            mpsc::error::TrySendError::Closed(_) => RendererError::Stopped,
        })?;
        Ok(JobTicket { progress, cancel, result })
    }

    /// Wakes the actor after a slot became wanted. With a full queue the actor is awake already.
    pub fn wake(&self) {
        let _ = self.commands.try_send(Command::Wake);
    }

    /// Requests the loss of the device, where the configuration allows it.
    pub async fn lose_device(&self) -> Result<(), RendererError> {
        self.send(Command::LoseDevice).await
    }

    /// Requests the actor to stop.
    pub async fn stop(&self) {
        let _ = self.send(Command::Stop).await;
    }

    fn key(&self) -> u64 {
        self.next_key.fetch_add(1, Ordering::Relaxed)
    }

    async fn send(&self, command: Command) -> Result<(), RendererError> {
        self.commands.send(command).await.map_err(|_| RendererError::Stopped)
    }

    async fn ask<T>(
        &self,
        make: impl FnOnce(oneshot::Sender<Result<T, RendererError>>) -> Command,
    ) -> Result<T, RendererError> {
        let (reply, answer) = oneshot::channel();
        self.send(make(reply)).await?;
        answer.await.map_err(|_| RendererError::Stopped)?
    }
}
