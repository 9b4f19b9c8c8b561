//! Why the domain refused or failed. HTTP maps it to problem documents and the live connection to close codes, once
//! each.

use std::fmt::Display;

use surfelcast_renderer::RendererError;
use surfelcast_renderer::scene::SceneError;
use surfelcast_store::StoreError;
use surfelcast_stream::StreamError;

/// A refusal or a failure; its text is for people and names the field, the limit and the remedy.
#[derive(Debug, thiserror::Error)]
pub(crate) enum DomainError {
    /// The renderer refused or failed.
    #[error(transparent)]
    Renderer(#[from] RendererError),
    /// A limit of the store.
    #[error(transparent)]
    StoreLimit(StoreError),
    /// An uploaded file is no scene that this server can render.
    #[error(transparent)]
    InvalidScene(SceneError),
    /// The output cannot be encoded in the requested format.
    #[error(transparent)]
    NotEncodable(StreamError),
    /// There is no such scene.
    #[error("scene: no such scene; GET /v1/scenes lists them")]
    UnknownScene,
    /// The scene belongs to the configuration of the server.
    #[error("scene: came with the server's start and cannot be deleted; restart without it")]
    BuiltinScene,
    /// As many scenes are loading or waiting for it as may.
    #[error("{limit} scenes are being loaded already; try again later")]
    LoadingBusy {
        /// The limit.
        limit: usize,
    },
    /// There is no such session.
    #[error("no such session; GET /v1/scenes lists them")]
    UnknownSession,
    /// The session has as many views as it may.
    #[error("the session has {limit} views already")]
    SessionFull {
        /// The limit.
        limit: u32,
    },
    /// The render still waits or runs.
    #[error("the render is not finished; ask GET /v1/renders/{{id}} for its progress")]
    NotFinished,
    /// The render was canceled, so there is no image.
    #[error("the render was canceled; send the request again")]
    RenderCanceled,
    /// A failure of the server itself; the cause is in the log and not in the answer.
    #[error("the server failed; the cause is in its log")]
    Internal,
}

impl DomainError {
    /// A failure of the server; the cause is logged here, once.
    pub(crate) fn internal(cause: &dyn Display) -> Self {
        tracing::error!(%cause, "request failed");
        Self::Internal
    }
}

impl From<StoreError> for DomainError {
    fn from(error: StoreError) -> Self {
        match error {
            StoreError::Missing => Self::UnknownScene,
            StoreError::Full { .. } | StoreError::TooManyRenders { .. } => Self::StoreLimit(error),
            StoreError::Io(cause) => Self::internal(&cause),
        }
    }
}
