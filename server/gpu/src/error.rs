//! What can go wrong on the GPU.

/// Why a call failed. Cheap to clone, so that a failed compilation can be returned to every caller.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum GpuError {
    /// No adapter can be used.
    #[error("no usable GPU adapter: {problem}; {remedy}")]
    NoAdapter {
        /// What was found.
        problem: String,
        /// What to install or change.
        remedy: String,
    },
    /// The device refused to open.
    #[error("adapter `{adapter}` could not be opened: {message}")]
    Open {
        /// Name.
        adapter: String,
        /// Message of the driver.
        message: String,
    },
    /// It exceeds the memory budget, or the driver is out of memory.
    #[error(
        "GPU memory: `{field}` needs {needed} bytes and {free} are free; close sessions, make pictures smaller or raise the memory budget"
    )]
    OutOfMemory {
        /// Label of the buffer.
        field: String,
        /// Bytes.
        needed: u64,
        /// Bytes left of the budget; 0 where the driver itself ran out.
        free: u64,
    },
    /// Larger than the largest binding of the device.
    #[error(
        "`{field}` needs {needed} bytes, this device binds at most {limit}; use a smaller scene or picture, or another adapter"
    )]
    TooLarge {
        /// Label of the buffer.
        field: String,
        /// Bytes.
        needed: u64,
        /// Bytes.
        limit: u64,
    },
    /// The device is lost; open a new one.
    #[error("the GPU device was lost: {reason}")]
    DeviceLost {
        /// Message of the driver, or ours.
        reason: String,
    },
    /// A kernel does not link, compile or fit the device.
    #[error("kernel `{kernel}`: {message}")]
    Pipeline {
        /// Name.
        kernel: String,
        /// Why.
        message: String,
    },
    /// A pass binds what its kernel does not declare, or lacks a binding that it declares.
    #[error("pass `{pass}`, binding `{name}`: {problem}")]
    Binding {
        /// Label of the pass.
        pass: String,
        /// Name of the binding.
        name: String,
        /// What is wrong and what would be correct.
        problem: String,
    },
    /// A call breaks a rule of the device.
    #[error("{context}: {message}")]
    Validation {
        /// Pass, graph or call.
        context: String,
        /// What is wrong.
        message: String,
    },
    /// A submission did not finish in time; the device counts as lost.
    #[error("`{graph}` did not finish within {limit_ms} ms; the device counts as lost")]
    Timeout {
        /// Label of the graph.
        graph: String,
        /// Milliseconds.
        limit_ms: u64,
    },
    /// Losing the device on purpose was not allowed when it was opened.
    #[error("losing the device on purpose is a test's right: open it with `allow_forced_loss`")]
    ForcedLossNotAllowed,
}

impl GpuError {
    /// Whether a new device must be opened.
    pub fn is_device_lost(&self) -> bool {
        matches!(self, GpuError::DeviceLost { .. } | GpuError::Timeout { .. })
    }
}
