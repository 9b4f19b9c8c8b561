//! How a command fails, and what it tells the shell.

use std::process::ExitCode;

use surfelcast_gpu::GpuError;
use surfelcast_measure::MeasureError;
use surfelcast_renderer::RendererError;
use surfelcast_scene::SceneError;
use surfelcast_techniques::TechniqueError;

/// A failed command.
#[derive(Debug)]
pub(crate) enum Failure {
    /// The command line or a file is at fault: exit code 2.
    Input(String),
    /// The machine or this program is at fault: exit code 1.
    Runtime(String),
}

impl Failure {
    pub(crate) fn input(message: impl Into<String>) -> Self {
        Self::Input(message.into())
    }

    pub(crate) fn runtime(message: impl Into<String>) -> Self {
        Self::Runtime(message.into())
    }

    /// Writes the message to stderr.
    #[allow(clippy::print_stderr, reason = "this is where the program speaks to its user")]
    pub(crate) fn report(&self) {
        let (Self::Input(message) | Self::Runtime(message)) = self;
        eprintln!("surfelcast: {message}");
    }

    pub(crate) fn exit_code(&self) -> ExitCode {
        match self {
            Self::Input(_) => ExitCode::from(2),
            Self::Runtime(_) => ExitCode::FAILURE,
        }
    }
}

impl From<SceneError> for Failure {
    fn from(error: SceneError) -> Self {
        Self::Input(error.to_string())
    }
}

impl From<RendererError> for Failure {
    fn from(error: RendererError) -> Self {
        match error {
            RendererError::SceneTooLarge { .. } => Self::Input(error.to_string()),
            error => Self::Runtime(error.to_string()),
        }
    }
}

impl From<GpuError> for Failure {
    fn from(error: GpuError) -> Self {
        RendererError::from(error).into()
    }
}

impl From<TechniqueError> for Failure {
    fn from(error: TechniqueError) -> Self {
        RendererError::from(error).into()
    }
}

impl From<MeasureError> for Failure {
    fn from(error: MeasureError) -> Self {
        match error {
            MeasureError::Plot(_) => Self::Runtime(error.to_string()),
            error => Self::Input(error.to_string()),
        }
    }
}
