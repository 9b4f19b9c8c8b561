//! A fake renderer: it answers every command with coloured noise and records the commands that it got.

use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::{Duration, Instant};

use surfelcast_render_api::{Column, Field, Row, Value};
use surfelcast_renderer::scene::{Camera, SceneEdit};
use surfelcast_renderer::{
    Command, CommandReceiver, DeviceInfo, DeviceState, ErrorEstimate, Frame, FrameKind, FrameSlot, Inspection,
    JobProgress, RayCounts, RenderJob, RenderOutput, RendererError, RendererHandle, RendererStatus, SessionKey,
    ViewKey, ViewState,
};
use tokio::sync::{oneshot, watch};

use crate::test_catalogue::catalogue;

/// Commands in the order in which the renderer got them; cameras by the x of their position.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Recorded {
    OpenSession,
    CloseSession,
    OpenView,
    CloseView,
    View {
        input_seq: u32,
        x: f64,
        is_moving: bool,
    },
    /// A view shows another output than before.
    Shows(Option<String>),
    Lights {
        scene_rev: u32,
        count: usize,
    },
    Inspect {
        size: [u32; 2],
        point: [f32; 2],
    },
    Render {
        seed: u64,
        aov: Option<String>,
        /// JSON of the settings.
        settings: serde_json::Value,
    },
}

/// Audited error of every finished render.
const ERROR: ErrorEstimate = ErrorEstimate {
    rmse_tonemapped: 0.0125,
    rel_mse: 0.5,
    std_error: 0.001,
    rmse_low: 0.011,
    rmse_high: 0.0145,
    mse_tonemapped: 1.5625e-4,
};

/// How the fake behaves.
#[derive(Clone, Debug)]
pub(crate) struct FakeBehaviour {
    /// Time for a frame.
    pub(crate) frame_time: Duration,
    /// Time for a job.
    pub(crate) job_time: Duration,
    /// Time to answer `inspect`.
    pub(crate) point_time: Duration,
    /// What lights a point; its position is that of the camera.
    pub(crate) inspection: Option<Inspection>,
    /// Samples at which a view has converged.
    pub(crate) final_samples: u32,
    /// Resolution factor at which a moving frame keeps its time.
    pub(crate) device_scale: f32,
    /// Answer of `OpenSession`.
    pub(crate) session_error: Option<RendererError>,
    /// Answers of the first jobs, in order.
    pub(crate) job_errors: Vec<RendererError>,
}

impl Default for FakeBehaviour {
    fn default() -> Self {
        Self {
            frame_time: Duration::from_millis(2),
            job_time: Duration::from_millis(5),
            point_time: Duration::ZERO,
            inspection: Some(Inspection {
                normal: [0.0, 1.0, 0.0],
                headline: "1 thing lights this point.".to_owned(),
                summary: vec![Field { id: "coverage", label: "Coverage", unit: "", value: Value::Number(1.5) }],
                columns: vec![Column { id: "id", label: "Thing", unit: "" }],
                rows: vec![Row { values: vec![Value::Count(7)], disc: None }],
                ..Inspection::default()
            }),
            final_samples: 64,
            device_scale: 1.0,
            session_error: None,
            job_errors: Vec::new(),
        }
    }
}

/// Test's end of the fake.
#[derive(Clone, Debug)]
pub(crate) struct Fake {
    pub(crate) handle: RendererHandle,
    pub(crate) status: watch::Sender<RendererStatus>,
    log: Arc<std::sync::Mutex<Vec<Recorded>>>,
}

impl Fake {
    pub(crate) fn start(behaviour: FakeBehaviour) -> Self {
        let (handle, commands, status) = RendererHandle::channel();
        status.send_replace(RendererStatus {
            state: DeviceState::Ready,
            device: DeviceInfo { name: "fake".into(), ..DeviceInfo::default() },
            catalogue: Arc::new(catalogue()),
            ..RendererStatus::default()
        });
        let log = Arc::default();
        let actor = Actor { behaviour, log: Arc::clone(&log), views: BTreeMap::new(), revisions: BTreeMap::new() };
        tokio::spawn(actor.run(commands));
        Self { handle, status, log }
    }

    pub(crate) fn recorded(&self) -> Vec<Recorded> {
        self.log.lock().expect("not poisoned").clone()
    }

    pub(crate) fn count(&self, wanted: fn(&Recorded) -> bool) -> usize {
        self.recorded().iter().filter(|recorded| wanted(recorded)).count()
    }

    pub(crate) fn set_state(&self, state: DeviceState) {
        self.status.send_modify(|status| {
            if status.state == DeviceState::Lost && state == DeviceState::Ready {
                status.epoch += 1;
            }
            status.state = state;
        });
    }
}

struct View {
    session: SessionKey,
    state: ViewState,
    slot: FrameSlot,
    samples: u32,
}

struct Actor {
    behaviour: FakeBehaviour,
    log: Arc<std::sync::Mutex<Vec<Recorded>>>,
    views: BTreeMap<ViewKey, View>,
    revisions: BTreeMap<SessionKey, u32>,
}

impl Actor {
    async fn run(mut self, mut commands: CommandReceiver) {
        loop {
            let ready = self.views.iter().find(|(_, view)| self.is_due(view)).map(|(key, _)| *key);
            tokio::select! {
                command = commands.recv() => match command {
                    None | Some(Command::Stop) => return,
                    Some(command) => self.handle(command),
                },
                () = tokio::time::sleep(self.behaviour.frame_time), if ready.is_some() => {
                    if let Some(key) = ready { self.render(key); }
                }
            }
        }
    }

    fn is_due(&self, view: &View) -> bool {
        view.slot.is_wanted() && !view.state.is_paused && view.samples < self.behaviour.final_samples
    }

    fn record(&self, recorded: Recorded) {
        self.log.lock().expect("not poisoned").push(recorded);
    }

    fn handle(&mut self, command: Command) {
        match command {
            Command::OpenSession { session, reply, .. } => {
                self.record(Recorded::OpenSession);
                self.revisions.insert(session, 1);
                let _ = reply.send(self.behaviour.session_error.clone().map_or(Ok(()), Err));
            }
            Command::CloseSession { .. } => self.record(Recorded::CloseSession),
            Command::EditScene { session, edit: SceneEdit::Lights(lights), scene_rev } => {
                self.record(Recorded::Lights { scene_rev, count: lights.punctual.len() });
                self.revisions.insert(session, scene_rev);
                self.views.values_mut().filter(|view| view.session == session).for_each(|view| view.samples = 0);
            }
            Command::OpenView { session, view, state, slot, reply } => {
                self.record(Recorded::OpenView);
                if state.aov.is_some() {
                    self.record(Recorded::Shows(state.aov.clone()));
                }
                self.views.insert(view, View { session, state, slot, samples: 0 });
                let _ = reply.send(Ok(()));
            }
            Command::UpdateView { view, state } => {
                let x = state.camera.position.x;
                self.record(Recorded::View { input_seq: state.input_seq, x, is_moving: state.is_moving });
                if self.views.get(&view).is_some_and(|view| view.state.aov != state.aov) {
                    self.record(Recorded::Shows(state.aov.clone()));
                }
                if let Some(view) = self.views.get_mut(&view) {
                    view.state = *state;
                    view.samples = 0;
                }
            }
            Command::CloseView { view } => {
                self.record(Recorded::CloseView);
                self.views.remove(&view);
            }
            Command::Pick { camera, reply, .. } => {
                let picked = surfelcast_renderer::scene::Picked { position: camera.position, object: "box".to_owned() };
                let _ = reply.send(Ok(Some(picked)));
            }
            Command::Inspect { camera, size, point, reply, .. } => {
                self.record(Recorded::Inspect { size, point });
                let found = self.behaviour.inspection.clone();
                let found = found.map(|found| Inspection { position: camera.position.to_array(), ..found });
                let time = self.behaviour.point_time;
                tokio::spawn(async move {
                    tokio::time::sleep(time).await;
                    let _ = reply.send(Ok(found));
                });
            }
            Command::Render { job, progress, cancel, reply } => {
                let spec = &job.spec;
                let settings = serde_json::to_value(&spec.settings).expect("encodes");
                self.record(Recorded::Render { seed: spec.seed, aov: spec.aov.clone(), settings });
                let error = (!self.behaviour.job_errors.is_empty()).then(|| self.behaviour.job_errors.remove(0));
                tokio::spawn(render_job(*job, self.behaviour.job_time, error, progress, cancel, reply));
            }
            Command::Wake | Command::LoseDevice | Command::Stop => {}
        }
    }

    fn render(&mut self, key: ViewKey) {
        let final_samples = self.behaviour.final_samples;
        let Some(view) = self.views.get_mut(&key) else { return };
        let kind = if view.state.is_moving {
            FrameKind::Moving
        } else {
            view.samples = (view.samples * 2).clamp(1, final_samples);
            if view.samples == final_samples { FrameKind::Final } else { FrameKind::Still }
        };
        let scale = if kind == FrameKind::Moving { view.state.max_scale.min(self.behaviour.device_scale) } else { 1.0 };
        let size = view.state.size.map(|side| ((side as f32 * scale) as u32).max(1));
        let frame = Frame {
            pixels: noise(&view.state.camera, size).into(),
            size,
            full_size: view.state.size,
            kind,
            input_seq: view.state.input_seq,
            scene_rev: self.revisions.get(&view.session).copied().unwrap_or(0),
            samples: view.samples.max(1),
            error: (kind == FrameKind::Final).then_some(ERROR),
            render_secs: 0.002,
            finished_at: Instant::now(),
            passes: Vec::new(),
            skipped: Vec::new(),
        };
        view.slot.put(Arc::new(frame));
    }
}

/// Pixels that no codec compresses well, so that the sizes of frames are realistic.
fn noise(camera: &Camera, size: [u32; 2]) -> Vec<u8> {
    let mut state = camera.position.x.to_bits() | 1;
    (0..size[0] * size[1])
        .flat_map(|_| {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            let bits = (state >> 33).to_le_bytes();
            [bits[0], bits[1], bits[2], 255]
        })
        .collect()
}

async fn render_job(
    job: RenderJob,
    time: Duration,
    error: Option<RendererError>,
    progress: watch::Sender<JobProgress>,
    mut cancel: watch::Receiver<bool>,
    reply: oneshot::Sender<Result<RenderOutput, RendererError>>,
) {
    progress.send_replace(JobProgress { is_running: true, samples: 1, fraction: 0.25, error: None });
    let canceled = async {
        if cancel.wait_for(|cancel| *cancel).await.is_err() {
            std::future::pending::<()>().await;
        }
    };
    let result = tokio::select! {
        () = canceled => Err(RendererError::Canceled),
        () = tokio::time::sleep(time) => error.map_or_else(|| Ok(output_of(&job)), Err),
    };
    let _ = reply.send(result);
}

fn output_of(job: &RenderJob) -> RenderOutput {
    let spec = &job.spec;
    let count = spec.size[0] as usize * spec.size[1] as usize;
    let mut state = spec.seed | 1;
    let pixels = (0..count)
        .map(|_| {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
            [(state >> 40) as f32 / 16_777_216.0, 0.5, 0.25]
        })
        .collect();
    RenderOutput {
        pixels,
        size: spec.size,
        samples: spec.stop.samples.unwrap_or(16),
        error: spec.aov.is_none().then_some(ERROR),
        rays: RayCounts::default(),
        render_secs: 0.25,
        setup_secs: 0.0,
        occupancy: None,
        export: None,
        passes: Vec::new(),
        skipped: Vec::new(),
        non_finite: 0,
        memory_bytes: vec![("scene".into(), 1234)],
        stopped_by: "samples",
    }
}
