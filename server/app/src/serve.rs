//! `surfelcast serve`: wires renderer and service, listens, stops on signals.

use std::path::PathBuf;
use std::sync::Arc;

use surfelcast::cli::ServeArgs;
use surfelcast::device::{renderer_config, wait_until_ready};
use surfelcast::{Failure, scene_file};
use surfelcast_renderer::RendererConfig;
use surfelcast_scene::Scene;
use surfelcast_service::{ServiceConfig, ServiceState};
use tokio::net::TcpListener;
use tokio_util::sync::CancellationToken;

pub(crate) fn run(args: &ServeArgs) -> Result<(), Failure> {
    let runtime = tokio::runtime::Builder::new_multi_thread()
        .enable_all()
        .build()
        .map_err(|error| Failure::runtime(format!("the runtime could not be started: {error}")))?;
    let config = RendererConfig {
        cache_dir: Some(args.data.join("cache")),
        snapshot_dir: Some(args.data.join("snapshots")),
        prepares_general_kernels: true,
        allow_forced_loss: std::env::var_os("SURFELCAST_ALLOW_FORCED_LOSS").is_some_and(|value| value == "1"),
        ..renderer_config(&args.device)
    };
    // The device opens on its own thread while the scenes are read here.
    let (renderer, thread) = surfelcast_renderer::start(config)
        .map_err(|error| Failure::runtime(format!("the render thread could not be started: {error}")))?;
    let scenes = load_scenes(&args.scenes)?;
    let outcome = runtime.block_on(async {
        let status = wait_until_ready(&renderer).await?;
        let mut config = ServiceConfig::new(&args.data, concat!("surfelcast/", env!("CARGO_PKG_VERSION")));
        config.hosts.extend(args.hosts.iter().cloned());
        config.origins.extend(args.origins.iter().cloned());
        let state =
            ServiceState::new(renderer.clone(), scenes, config).map_err(|error| Failure::runtime(error.to_string()))?;
        let listener = TcpListener::bind(args.bind)
            .await
            .map_err(|error| Failure::runtime(format!("--bind {}: {error}", args.bind)))?;
        let address = listener.local_addr().map_err(|error| Failure::runtime(error.to_string()))?;
        announce(&format!("surfelcast renders on {} and listens on http://{address}/", status.device.name));
        let shutdown = CancellationToken::new();
        tokio::spawn(cancel_on_signal(shutdown.clone()));
        let served = surfelcast_service::run(listener, state, shutdown).await;
        renderer.stop().await;
        served.map_err(|error| Failure::runtime(format!("listening failed: {error}")))
    });
    if thread.join().is_err() {
        return Err(Failure::runtime("the render thread ended in a panic; please report this"));
    }
    outcome
}

fn load_scenes(paths: &[PathBuf]) -> Result<Vec<Arc<Scene>>, Failure> {
    if paths.is_empty() {
        return scene_file::load_demos();
    }
    paths.iter().map(|path| scene_file::load(path, None, None).map(Arc::new)).collect()
}

/// Interrupt and termination both drain.
async fn cancel_on_signal(shutdown: CancellationToken) {
    let interrupt = tokio::signal::ctrl_c();
    #[cfg(unix)]
    {
        if let Ok(mut terminate) = tokio::signal::unix::signal(tokio::signal::unix::SignalKind::terminate()) {
            tokio::select! {
                _ = interrupt => {}
                _ = terminate.recv() => {}
            }
            shutdown.cancel();
            return;
        }
    }
    let _ = interrupt.await;
    shutdown.cancel();
}

#[allow(clippy::print_stdout, reason = "the address is the command's output")]
fn announce(message: &str) {
    println!("{message}");
}
