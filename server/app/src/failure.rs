//! How a command fails, and what it tells the shell.

use std::process::ExitCode;

use surfelcast_gpu::GpuError;
use surfelcast_renderer::RendererError;
use surfelcast_scene::SceneError;
use surfelcast_techniques::TechniqueError;

/// A failed command.
#[derive(Debug)]
pub enum Failure {
    /// The command line or a file is at fault: exit code 2.
    Input(String),
    /// The machine or this program is at fault: exit code 1.
    Runtime(String),
}

impl Failure {
    /// A fault of the command line or of a file.
    pub fn input(message: impl Into<String>) -> Self {
        Self::Input(message.into())
    }

    /// A fault of the machine or of this program.
    pub fn runtime(message: impl Into<String>) -> Self {
        Self::Runtime(message.into())
    }

    /// What the shell gets.
    pub fn exit_code(&self) -> ExitCode {
        match self {
            Self::Input(_) => ExitCode::from(2),
            Self::Runtime(_) => ExitCode::FAILURE,
        }
    }
}

impl std::fmt::Display for Failure {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let (Self::Input(message) | Self::Runtime(message)) = self;
        f.write_str(message)
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
