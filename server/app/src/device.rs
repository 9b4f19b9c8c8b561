//! Opening the render device.

use surfelcast_renderer::{DeviceState, RendererConfig, RendererHandle, RendererStatus};

use crate::args::DeviceArgs;
use crate::failure::Failure;

/// Device configuration of the command line.
pub fn renderer_config(args: &DeviceArgs) -> RendererConfig {
    RendererConfig {
        adapter: args.adapter.clone(),
        memory_budget_bytes: args.memory_budget_bytes(),
        ..RendererConfig::default()
    }
}

/// Waits until the device is open.
pub async fn wait_until_ready(renderer: &RendererHandle) -> Result<RendererStatus, Failure> {
    let mut status = renderer.status();
    let ready = status
        .wait_for(|status| matches!(status.state, DeviceState::Ready | DeviceState::Failed))
        .await
        .map_err(|_| Failure::runtime("the render thread ended before the device was open"))?
        .clone();
    if ready.state == DeviceState::Failed {
        return Err(Failure::runtime(
            "no render device could be opened; `surfelcast doctor` says what is missing and how to get it",
        ));
    }
    Ok(ready)
}
