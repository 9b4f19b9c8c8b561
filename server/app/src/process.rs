//! What a program does before and after its command.

use std::process::ExitCode;

use crate::failure::Failure;

/// Prepares the process: quiets the Vulkan loader and starts the log. To be called first, before any thread is started.
pub fn start(verbose: u8) {
    quiet_loader();
    init_log(verbose);
}

/// Reports a failed command to its user and maps the outcome to an exit code.
pub fn exit_code(program: &str, outcome: Result<(), Failure>) -> ExitCode {
    match outcome {
        Ok(()) => ExitCode::SUCCESS,
        Err(failure) => {
            report(program, &failure);
            failure.exit_code()
        }
    }
}

#[allow(clippy::print_stderr, reason = "this is where a program speaks to its user")]
fn report(program: &str, failure: &Failure) {
    eprintln!("{program}: {failure}");
}

/// Mesa's device-select layer writes to stderr whenever adapters are enumerated without a desktop session, and
/// surfelcast chooses its device itself.
#[allow(unsafe_code, reason = "the environment can only be changed so")]
fn quiet_loader() {
    // SAFETY: no other thread has been started yet.
    unsafe { std::env::set_var("NODEVICE_SELECT", "1") };
}

/// Logs go to stderr: warnings by default, more with `-v` or by `RUST_LOG`.
fn init_log(verbose: u8) {
    let level = match verbose {
        0 => "warn,surfelcast=warn",
        1 => "info",
        _ => "debug",
    };
    let filter = tracing_subscriber::EnvFilter::try_from_default_env().unwrap_or_else(|_| {
        tracing_subscriber::EnvFilter::new(format!("{level},wgpu_hal=error,wgpu_core=error,naga=error"))
    });
    tracing_subscriber::fmt().with_env_filter(filter).with_writer(std::io::stderr).init();
}
