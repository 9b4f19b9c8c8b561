//! The actor on a real device (software rendering suffices): jobs, views, lights, limits, loss of the device.
#![allow(clippy::unwrap_used, reason = "a test may stop at the first surprise")]

use std::sync::Arc;
use std::time::Duration;

use surfelcast_renderer::scene::{LightState, LoadOptions, Scene, SceneEdit, ViewFile, demo, load_bytes};
use surfelcast_renderer::{
    DeviceState, Frame, FrameKind, FrameSlot, MaterialMode, RenderJob, RenderSpec, RendererConfig, RendererError,
    RendererHandle, Settings, StopRules, ViewState, start,
};

/// Longest wait for anything a test expects.
const PATIENCE: Duration = Duration::from_mins(2);

fn cornell_box() -> Arc<Scene> {
    let scenes = demo::scenes();
    let demo = scenes.iter().find(|demo| demo.name == "cornell_box").unwrap();
    let view = ViewFile::parse(demo.view.as_bytes()).unwrap();
    Arc::new(load_bytes(&demo.glb, demo.name, &LoadOptions { view: Some(view), ..LoadOptions::default() }).unwrap())
}

fn spec(scene: &Arc<Scene>, samples: u32) -> RenderSpec {
    RenderSpec {
        scene: scene.id.to_string(),
        camera: scene.cameras[0].camera,
        size: [48, 48],
        technique: "path".to_owned(),
        settings: Settings::default(),
        materials: MaterialMode::Lambert,
        seed: 7,
        stop: StopRules { samples: Some(samples), ..StopRules::default() },
        exposure: 1.0,
        aov: None,
    }
}

fn job_of(scene: &Arc<Scene>, spec: RenderSpec) -> RenderJob {
    RenderJob { scene: Arc::clone(scene), lights: None, spec, exports: false }
}

fn job(scene: &Arc<Scene>, samples: u32) -> RenderJob {
    job_of(scene, spec(scene, samples))
}

fn view_state(scene: &Arc<Scene>) -> ViewState {
    ViewState {
        camera: scene.cameras[0].camera,
        size: [48, 40],
        exposure: 1.0,
        technique: "path".to_owned(),
        settings: Settings::default(),
        aov: None,
        is_moving: false,
        is_paused: false,
        max_scale: 1.0,
        target_frame_secs: 0.1,
        max_error: 1e-6,
        max_samples: 16,
        input_seq: 1,
    }
}

/// A running actor; the thread is joined at the end, since drivers do not like to be torn down while in use.
struct Running {
    handle: RendererHandle,
    thread: Option<std::thread::JoinHandle<()>>,
}

impl std::ops::Deref for Running {
    type Target = RendererHandle;

    fn deref(&self) -> &RendererHandle {
        &self.handle
    }
}

impl Running {
    async fn stop(mut self) {
        self.handle.stop().await;
        let thread = self.thread.take().unwrap();
        tokio::task::spawn_blocking(|| thread.join()).await.unwrap().unwrap();
    }
}

async fn ready(config: RendererConfig) -> Running {
    let (handle, thread) = start(config).unwrap();
    let renderer = Running { handle, thread: Some(thread) };
    let mut status = renderer.status();
    tokio::time::timeout(PATIENCE, status.wait_for(|s| s.state == DeviceState::Ready)).await.unwrap().unwrap();
    renderer
}

/// Requests frames until one fits.
async fn frame_where(renderer: &RendererHandle, slot: &FrameSlot, fits: impl Fn(&Frame) -> bool) -> Arc<Frame> {
    tokio::time::timeout(PATIENCE, async {
        loop {
            slot.want();
            renderer.wake();
            let frame = slot.take().await.expect("the view stays open");
            if fits(&frame) {
                return frame;
            }
        }
    })
    .await
    .expect("a frame in time")
}

fn brightness(frame: &Frame) -> f64 {
    let sum: u64 = frame.pixels.chunks_exact(4).map(|p| u64::from(p[0]) + u64::from(p[1]) + u64::from(p[2])).sum();
    sum as f64 / (frame.pixels.len() as f64 * 0.75)
}

#[tokio::test]
async fn the_same_job_gives_the_same_bytes_and_a_seed_changes_them() {
    let renderer = ready(RendererConfig::default()).await;
    let scene = cornell_box();
    let first = renderer.render(job(&scene, 20)).unwrap().result.await.unwrap().unwrap();
    let second = renderer.render(job(&scene, 20)).unwrap().result.await.unwrap().unwrap();
    assert_eq!(first.pixels, second.pixels);
    assert_eq!(first.error, second.error);
    assert_eq!((first.samples, first.stopped_by, first.non_finite), (20, "samples", 0));
    let other = renderer
        .render(job_of(&scene, RenderSpec { seed: 8, ..spec(&scene, 20) }))
        .unwrap()
        .result
        .await
        .unwrap()
        .unwrap();
    assert_ne!(first.pixels, other.pixels);
    renderer.stop().await;
}

#[tokio::test]
async fn a_job_stops_at_the_error_it_was_given() {
    let renderer = ready(RendererConfig::default()).await;
    let scene = cornell_box();
    let stop = StopRules { max_error: Some(0.02), ..StopRules::default() };
    let output =
        renderer.render(job_of(&scene, RenderSpec { stop, ..spec(&scene, 1) })).unwrap().result.await.unwrap().unwrap();
    assert_eq!(output.stopped_by, "max_error");
    let error = output.error.unwrap();
    assert!(error.rmse_tonemapped <= 0.02, "{error:?}");
    // Measured against an image with far less noise.
    let truth = renderer
        .render(job_of(&scene, RenderSpec { seed: 99, ..spec(&scene, 2048) }))
        .unwrap()
        .result
        .await
        .unwrap()
        .unwrap();
    let tone = |c: &[f32; 3]| c.map(|v| f64::from(v) / (1.0 + f64::from(c[0].max(c[1]).max(c[2]))));
    let squares: f64 = output
        .pixels
        .iter()
        .zip(&truth.pixels)
        .map(|(a, b)| tone(a).iter().zip(tone(b)).map(|(x, y)| (x - y).powi(2)).sum::<f64>() / 3.0)
        .sum();
    let measured = (squares / output.pixels.len() as f64).sqrt();
    assert!(measured <= 0.02 * 1.15 && measured > 0.008, "{measured} against {error:?} at {}", output.samples);
    renderer.stop().await;
}

/// The error stated with a view's final frame is that of this frame, not that of the last scheduled audit.
#[tokio::test]
async fn a_converged_view_states_the_error_of_what_it_shows() {
    let renderer = ready(RendererConfig::default()).await;
    let scene = cornell_box();
    let state = ViewState { max_samples: 31, ..view_state(&scene) };
    // The job comes first: it compiles the audit, which a view does not wait for while it refines.
    let same = RenderSpec { size: state.size, seed: 0, materials: MaterialMode::Pbr, ..spec(&scene, 31) };
    let same = job_of(&scene, same);
    let output = renderer.render(same).unwrap().result.await.unwrap().unwrap();
    let session = renderer.open_session(Arc::clone(&scene)).await.unwrap();
    let slot = FrameSlot::default();
    renderer.open_view(session, state, slot.clone()).await.unwrap();
    let last = frame_where(&renderer, &slot, |frame| frame.kind == FrameKind::Final).await;
    let (stated, expected) = (last.error.unwrap(), output.error.unwrap());
    assert!((stated.rmse_tonemapped / expected.rmse_tonemapped - 1.0).abs() < 0.01, "{stated:?} {expected:?}");
    renderer.stop().await;
}

#[tokio::test]
async fn a_canceled_job_keeps_what_it_has_or_says_so() {
    let renderer = ready(RendererConfig::default()).await;
    let scene = cornell_box();
    let mut ticket = renderer.render(job(&scene, 1 << 20)).unwrap();
    ticket.progress.wait_for(|progress| progress.samples > 0).await.unwrap();
    ticket.cancel.send(true).unwrap();
    let output = tokio::time::timeout(PATIENCE, ticket.result).await.unwrap().unwrap().unwrap();
    assert_eq!(output.stopped_by, "canceled");
    let ticket = renderer.render(job(&scene, 1 << 20)).unwrap();
    ticket.cancel.send(true).unwrap();
    let answer = tokio::time::timeout(PATIENCE, ticket.result).await.unwrap().unwrap();
    assert!(matches!(answer, Err(RendererError::Canceled) | Ok(_)), "{answer:?}");
    renderer.stop().await;
}

#[tokio::test]
async fn jobs_beyond_the_queue_are_refused() {
    let config = RendererConfig { max_queued_jobs: 1, max_running_jobs: 1, ..RendererConfig::default() };
    let renderer = ready(config).await;
    let scene = cornell_box();
    let tickets: Vec<_> = (0..8).map(|_| renderer.render(job(&scene, 1 << 20)).unwrap()).collect();
    let mut busy = 0;
    for ticket in tickets {
        let _ = ticket.cancel.send(true);
        if let Err(RendererError::Busy { limit: 1, .. }) =
            tokio::time::timeout(PATIENCE, ticket.result).await.unwrap().unwrap()
        {
            busy += 1;
        }
    }
    assert!(busy > 0, "eight jobs fit into a queue of one");
    renderer.stop().await;
}

#[tokio::test]
async fn a_view_converges_and_then_costs_nothing() {
    let renderer = ready(RendererConfig::default()).await;
    let scene = cornell_box();
    let session = renderer.open_session(Arc::clone(&scene)).await.unwrap();
    let slot = FrameSlot::default();
    renderer.open_view(session, view_state(&scene), slot.clone()).await.unwrap();
    let last = frame_where(&renderer, &slot, |frame| frame.kind == FrameKind::Final).await;
    assert_eq!((last.samples, last.size, last.input_seq), (16, [48, 40], 1));
    assert!(last.error.is_some() && brightness(&last) > 10.0);

    slot.want();
    renderer.wake();
    tokio::time::sleep(Duration::from_millis(300)).await;
    let before = renderer.status().borrow().clone();
    tokio::time::sleep(Duration::from_millis(500)).await;
    let after = renderer.status().borrow().clone();
    assert_eq!((before.ray_count, before.frame_count), (after.ray_count, after.frame_count));
    assert_eq!(after.idle_view_count, 1);
    renderer.stop().await;
}

#[tokio::test]
async fn a_moving_camera_is_answered_and_light_edits_show() {
    let renderer = ready(RendererConfig::default()).await;
    let scene = cornell_box();
    let session = renderer.open_session(Arc::clone(&scene)).await.unwrap();
    let slot = FrameSlot::default();
    let view = renderer.open_view(session, view_state(&scene), slot.clone()).await.unwrap();
    let bright = frame_where(&renderer, &slot, |frame| frame.kind == FrameKind::Final).await;

    let mut moved = view_state(&scene);
    moved.camera.position.x += 0.1;
    moved.is_moving = true;
    moved.input_seq = 5;
    renderer.update_view(view, moved.clone()).await.unwrap();
    let moving = frame_where(&renderer, &slot, |frame| frame.input_seq == 5).await;
    assert_eq!(moving.kind, FrameKind::Moving);
    assert_ne!(moving.pixels, bright.pixels);
    renderer.update_view(view, ViewState { is_moving: false, input_seq: 6, ..moved.clone() }).await.unwrap();
    frame_where(&renderer, &slot, |frame| frame.kind == FrameKind::Final && frame.input_seq == 6).await;

    let dark = LightState { emissive_strength: 0.0, ..LightState::of_scene(&scene) };
    renderer.edit_scene(session, SceneEdit::Lights(dark), 2).await.unwrap();
    let black = frame_where(&renderer, &slot, |frame| frame.kind == FrameKind::Final && frame.scene_rev == 2).await;
    assert!(brightness(&black) < 0.5, "{}", brightness(&black));

    // Exposure only affects display: the same samples are shown again.
    renderer.edit_scene(session, SceneEdit::Lights(LightState::of_scene(&scene)), 3).await.unwrap();
    let again = frame_where(&renderer, &slot, |frame| frame.kind == FrameKind::Final && frame.scene_rev == 3).await;
    let exposed = ViewState { is_moving: false, input_seq: 7, exposure: 4.0, ..moved };
    renderer.update_view(view, exposed).await.unwrap();
    let brighter = frame_where(&renderer, &slot, |frame| frame.input_seq == 7).await;
    assert_eq!((brighter.kind, brighter.samples), (FrameKind::Final, again.samples));
    assert!(brightness(&brighter) > brightness(&again) * 1.2);
    renderer.stop().await;
}

#[tokio::test]
async fn a_paused_view_renders_nothing() {
    let renderer = ready(RendererConfig::default()).await;
    let scene = cornell_box();
    let session = renderer.open_session(Arc::clone(&scene)).await.unwrap();
    let slot = FrameSlot::default();
    let paused = ViewState { is_paused: true, ..view_state(&scene) };
    let view = renderer.open_view(session, paused.clone(), slot.clone()).await.unwrap();
    slot.want();
    renderer.wake();
    assert!(tokio::time::timeout(Duration::from_millis(400), slot.take()).await.is_err());
    assert_eq!(renderer.status().borrow().ray_count, 0);
    renderer.update_view(view, ViewState { is_paused: false, ..paused }).await.unwrap();
    frame_where(&renderer, &slot, |frame| frame.kind == FrameKind::Final).await;
    renderer.stop().await;
}

#[tokio::test]
async fn a_scene_that_does_not_fit_is_refused_before_upload() {
    let renderer = ready(RendererConfig { memory_budget_bytes: Some(2048), ..RendererConfig::default() }).await;
    let answer = renderer.open_session(cornell_box()).await;
    assert!(matches!(answer, Err(RendererError::SceneTooLarge { limit: 2048, .. })), "{answer:?}");
    assert_eq!(renderer.status().borrow().memory_used_bytes, 0);
    renderer.stop().await;
}

#[tokio::test]
async fn a_lost_device_comes_back_with_sessions_and_jobs() {
    let renderer = ready(RendererConfig { allow_forced_loss: true, ..RendererConfig::default() }).await;
    let scene = cornell_box();
    let session = renderer.open_session(Arc::clone(&scene)).await.unwrap();
    let slot = FrameSlot::default();
    let view = renderer.open_view(session, view_state(&scene), slot.clone()).await.unwrap();
    let before = frame_where(&renderer, &slot, |frame| frame.kind == FrameKind::Final).await;
    let undisturbed = renderer.render(job(&scene, 64)).unwrap().result.await.unwrap().unwrap();
    let mut running = renderer.render(job(&scene, 64)).unwrap();
    let is_running = running.progress.wait_for(|progress| progress.is_running);
    tokio::time::timeout(PATIENCE, is_running).await.unwrap().unwrap();

    renderer.lose_device().await.unwrap();
    let mut status = renderer.status();
    let recovered = status.wait_for(|s| s.epoch == 1 && s.state == DeviceState::Ready);
    tokio::time::timeout(PATIENCE, recovered).await.unwrap().unwrap();
    let after = frame_where(&renderer, &slot, |frame| frame.kind == FrameKind::Final).await;
    assert_eq!(before.pixels, after.pixels, "the same view on the same device");
    let output = tokio::time::timeout(PATIENCE, running.result).await.unwrap().unwrap().unwrap();
    assert_eq!(output.samples, 64);
    assert_eq!(output.pixels, undisturbed.pixels, "the job started over");

    // Three losses in five minutes: the device is given up, views are closed and jobs fail.
    renderer.lose_device().await.unwrap();
    tokio::time::timeout(PATIENCE, status.wait_for(|s| s.epoch == 2)).await.unwrap().unwrap();
    let mut endless = renderer.render(job(&scene, 1 << 20)).unwrap();
    let has_samples = endless.progress.wait_for(|progress| progress.samples > 0);
    tokio::time::timeout(PATIENCE, has_samples).await.unwrap().unwrap();
    renderer.lose_device().await.unwrap();
    tokio::time::timeout(PATIENCE, status.wait_for(|s| s.state == DeviceState::Failed)).await.unwrap().unwrap();
    let answer = tokio::time::timeout(PATIENCE, endless.result).await.unwrap().unwrap();
    assert_eq!(answer.map(|output| output.samples), Err(RendererError::DeviceLost), "it may be sent again");
    assert_eq!(tokio::time::timeout(PATIENCE, async { while slot.take().await.is_some() {} }).await, Ok(()));
    assert_eq!(renderer.open_session(scene).await, Err(RendererError::DeviceLost));
    renderer.close_view(view).await.unwrap();
    renderer.stop().await;
}

#[tokio::test]
async fn unknown_techniques_and_sessions_are_refused() {
    let renderer = ready(RendererConfig::default()).await;
    let scene = cornell_box();
    let unknown = job_of(&scene, RenderSpec { technique: "radiosity".to_owned(), ..spec(&scene, 1) });
    let answer = renderer.render(unknown).unwrap().result.await.unwrap();
    assert!(matches!(&answer, Err(RendererError::Unsupported(text)) if text.contains("radiosity")), "{answer:?}");
    let session = renderer.open_session(Arc::clone(&scene)).await.unwrap();
    renderer.close_session(session).await.unwrap();
    let answer = renderer.open_view(session, view_state(&scene), FrameSlot::default()).await;
    assert_eq!(answer, Err(RendererError::Unknown("the session")));
    renderer.stop().await;
}
