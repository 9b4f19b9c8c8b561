//! Why the renderer refused or failed.

use surfelcast_gpu::GpuError;
use surfelcast_techniques::TechniqueError;

/// Why the renderer refused or failed.
#[derive(Debug, Clone, thiserror::Error, PartialEq, Eq)]
pub enum RendererError {
    /// The actor has stopped.
    #[error("the renderer has stopped")]
    Stopped,
    /// The command queue or job queue is full.
    #[error("the renderer is busy: {limit} {what} are waiting already; try again later")]
    Busy {
        /// What is waiting.
        what: &'static str,
        /// The limit.
        limit: usize,
    },
    /// The scene does not fit into the device memory that is free now.
    #[error("the scene needs {needed} bytes of device memory, {free} are free; close a session or try again later")]
    NoMemory {
        /// Bytes needed.
        needed: u64,
        /// Bytes free.
        free: u64,
    },
    /// The scene can never fit this device.
    #[error("{field} needs {needed} bytes, over the device's limit of {limit}")]
    SceneTooLarge {
        /// What is too large.
        field: String,
        /// Bytes needed.
        needed: u64,
        /// The limit.
        limit: u64,
    },
    /// This device, technique or scene cannot do it, or the device failed without being lost.
    #[error("{0}")]
    Unsupported(String),
    /// There is no device: it was lost and has not been opened again. The request may be sent again.
    #[error("the render device was lost; the work may be sent again")]
    DeviceLost,
    /// Canceled before there was an image.
    #[error("the render was canceled")]
    Canceled,
    /// No such session or view.
    #[error("{0} does not exist")]
    Unknown(&'static str),
}

impl From<GpuError> for RendererError {
    fn from(error: GpuError) -> Self {
        match error {
            GpuError::OutOfMemory { needed, free, .. } => Self::NoMemory { needed, free },
            GpuError::TooLarge { field, needed, limit } => Self::SceneTooLarge { field, needed, limit },
            error if error.is_device_lost() => Self::DeviceLost,
            error => Self::Unsupported(error.to_string()),
        }
    }
}

impl From<TechniqueError> for RendererError {
    fn from(error: TechniqueError) -> Self {
        match error {
            TechniqueError::Gpu(error) => error.into(),
            error @ TechniqueError::Unsupported { .. } => Self::Unsupported(error.to_string()),
        }
    }
}
