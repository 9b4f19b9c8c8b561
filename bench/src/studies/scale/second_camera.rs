//! What a second camera adds on a session that has converged.
//!
//! Two questions. What does it cost on surfaces whose surfels others have converged? It stands between two cameras
//! that the session has served before, and its first frames are compared with those of the very first camera, which
//! started with an empty session. And what do both cost once they have converged? The render actor answers that,
//! since it schedules no work for converged views.

use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::Duration;

use surfelcast::Failure;
use surfelcast::device::wait_until_ready;
use surfelcast_render_api::Settings;
use surfelcast_renderer::{FrameKind, FrameSlot, RendererConfig, RendererHandle, SessionKey, ViewState};
use surfelcast_scene::{Camera, Scene};
use surfelcast_techniques::SessionState;
use surfelcast_techniques::surfel::SurfelSettings;

use crate::report::Table;
use crate::stage::{Shot, Stage};
use crate::studies::scale::measure::{SEED, SURFEL};
use crate::studies::scale::scene::{camera_at, tessellated_room};

/// Places of the cameras, radians about the room: the first, the last, and the second between both.
const FIRST: f64 = 0.0;
const BETWEEN: f64 = 0.12;
const LAST: f64 = 0.24;
/// Standard error at which surfels have converged, tone-mapped: loose, so that the session converges soon.
const TARGET: f32 = 0.02;
/// A session has converged when its rays per frame have fallen to this share of those of its first frames ...
const CONVERGED_SHARE: f64 = 0.01;
/// ... or after this number of frames.
const MOST_FRAMES: u32 = 512;
/// Samples of the actor's views, the pause after they have converged, and how long they are observed at rest.
const VIEW_SAMPLES: u32 = 16;
const PAUSE: Duration = Duration::from_millis(500);
const OBSERVED: Duration = Duration::from_secs(2);

/// GPU milliseconds and rays of the cache over some frames, by frame.
fn first_frames(shot: &mut Shot<'_>, frames: u32) -> Result<[f64; 2], Failure> {
    shot.render(frames, f64::INFINITY)?;
    Ok([shot.cost().gpu_secs * 1e3, shot.cost().rays[1] as f64].map(|sum| sum / f64::from(frames)))
}

/// Continues until the cache requests few rays; returns the number of frames that took.
fn converge(shot: &mut Shot<'_>, frames: u32, rays_at_first: f64) -> Result<u32, Failure> {
    let mut samples = frames;
    while samples < MOST_FRAMES {
        let before = shot.cost().rays[1];
        samples += frames;
        shot.render(samples, f64::INFINITY)?;
        if ((shot.cost().rays[1] - before) as f64) < CONVERGED_SHARE * rays_at_first * f64::from(frames) {
            break;
        }
    }
    Ok(samples)
}

pub(super) fn measure(stage: &Stage<'_>, frames: u32) -> Result<BTreeMap<String, f64>, Failure> {
    let settings = Settings::from(SurfelSettings { target_error: TARGET, ..SurfelSettings::default() });
    let session = SessionState::default();
    let mut first = stage.shot(SURFEL, &settings, camera_at(FIRST), SEED, &session)?;
    let [first_ms, first_rays] = first_frames(&mut first, frames)?;
    let frames_to_converge = converge(&mut first, frames, first_rays)?;
    let mut last = stage.shot(SURFEL, &settings, camera_at(LAST), SEED, &session)?;
    first_frames(&mut last, frames)?;
    converge(&mut last, frames, first_rays)?;
    drop(last);
    let mut second = stage.shot(SURFEL, &settings, camera_at(BETWEEN), SEED, &session)?;
    let [second_ms, second_rays] = first_frames(&mut second, frames)?;
    let values = [
        ("first_gpu_ms", first_ms),
        ("first_cache_rays", first_rays),
        ("frames_to_converge", f64::from(frames_to_converge)),
        ("second_gpu_ms", second_ms),
        ("second_cache_rays", second_rays),
        ("share", second_ms / first_ms),
        ("rays_once_converged", rays_at_rest(stage)? as f64),
    ];
    Ok(values.map(|(name, value)| (name.to_owned(), value)).into())
}

pub(super) fn markdown(values: &BTreeMap<String, f64>, frames: u32) -> String {
    let value = |name: &str| values.get(name).copied().unwrap_or(0.0);
    let mut table = Table::new(["camera", "GPU ms a frame", "rays of the cache a frame"]);
    for which in ["first", "second"] {
        table.push([
            which.to_owned(),
            format!("{:.1}", value(&format!("{which}_gpu_ms"))),
            format!("{:.0}", value(&format!("{which}_cache_rays"))),
        ]);
    }
    format!(
        "\nA second camera on surfaces whose surfels have converged takes {:.0} % of the GPU time of the first one, \
         which started with an empty session, over the first {frames} frames of each; below 35 % is required. The \
         session had converged before (after {:.0} frames; surfels have converged at a standard error of {TARGET} \
         here). In {} s after both views of a session had converged, the renderer traced {:.0} rays; 0 is \
         required.\n\n{}",
        100.0 * value("share"),
        value("frames_to_converge"),
        OBSERVED.as_secs(),
        value("rays_once_converged"),
        table.markdown()
    )
}

/// Rays that the actor traces while two converged views of a session are observed.
fn rays_at_rest(stage: &Stage<'_>) -> Result<u64, Failure> {
    let runtime = tokio::runtime::Builder::new_current_thread()
        .enable_all()
        .build()
        .map_err(|error| Failure::runtime(format!("the runtime could not be started: {error}")))?;
    let config = RendererConfig { adapter: Some(stage.gpu.info().index.to_string()), ..RendererConfig::default() };
    let (renderer, thread) = surfelcast_renderer::start(config)
        .map_err(|error| Failure::runtime(format!("the render thread could not be started: {error}")))?;
    // The actor shares ownership of its scenes.
    let scene = Arc::new(tessellated_room(stage.scene.summary.triangle_count)?);
    let outcome = runtime.block_on(async {
        wait_until_ready(&renderer).await?;
        let rays = observe(&renderer, scene, stage.size).await;
        renderer.stop().await;
        rays
    });
    if thread.join().is_err() {
        return Err(Failure::runtime("the render thread ended in a panic; please report this"));
    }
    outcome
}

async fn observe(renderer: &RendererHandle, scene: Arc<Scene>, size: [u32; 2]) -> Result<u64, Failure> {
    let session = renderer.open_session(scene).await?;
    let mut slots = Vec::new();
    for angle in [FIRST, BETWEEN] {
        slots.push(converged_view(renderer, session, camera_at(angle), size).await?);
    }
    // The last step is counted a moment after its frame has arrived.
    tokio::time::sleep(PAUSE).await;
    let before = renderer.status().borrow().ray_count;
    slots.iter().for_each(FrameSlot::want);
    renderer.wake();
    tokio::time::sleep(OBSERVED).await;
    let after = renderer.status().borrow().ray_count;
    Ok(after - before)
}

/// Opens a view and waits until it has converged.
async fn converged_view(
    renderer: &RendererHandle,
    session: SessionKey,
    camera: Camera,
    size: [u32; 2],
) -> Result<FrameSlot, Failure> {
    let slot = FrameSlot::default();
    let state = ViewState {
        camera,
        size,
        exposure: 1.0,
        technique: SURFEL.to_owned(),
        settings: Settings::default(),
        aov: None,
        is_moving: false,
        is_paused: false,
        max_scale: 1.0,
        target_frame_secs: 0.1,
        max_error: 1e-6,
        max_samples: VIEW_SAMPLES,
        input_seq: 1,
    };
    slot.want();
    renderer.open_view(session, state, slot.clone()).await?;
    loop {
        let frame = slot.take().await.ok_or_else(|| Failure::runtime("the view ended early"))?;
        if frame.kind == FrameKind::Final {
            return Ok(slot);
        }
        slot.want();
        renderer.wake();
    }
}
