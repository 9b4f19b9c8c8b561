//! The render actor: one thread that owns the device and shares its time.
//!
//! Each turn takes all waiting commands, picks who works next, and lets it do one short step. Views in a gesture come
//! first; stills and jobs share what is left by device time used. With nothing to do the thread sleeps on its channel.

use std::collections::{BTreeMap, VecDeque};
use std::sync::Arc;
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use surfelcast_gpu::{Gpu, GpuOptions};
use surfelcast_passes::features::general_features;
use surfelcast_scene::{Camera, Scene};
use surfelcast_techniques::{
    Change, FrameView, LightBuffers, LightState, MaterialMode, SceneBuffers, SessionState, SurfelSettings, registry,
};
use tokio::sync::{mpsc, watch};

use crate::command::{Command, CommandReceiver, Picked, Reply, SessionKey, ViewKey};
use crate::config::RendererConfig;
use crate::error::RendererError;
use crate::handle::RendererHandle;
use crate::inspection::{self, Inspection};
use crate::job::{JobProgress, RenderJob, RenderOutput};
use crate::running_job::{JobState, RunningJob, kernels_of};
use crate::running_view::RunningView;
use crate::scenes::SceneStore;
use crate::snapshots;
use crate::status::{DeviceInfo, DeviceState, RendererStatus, TechniqueDescription};

/// Losses within [`LOSS_WINDOW`] after which the device is given up.
const MAX_LOSSES: usize = 3;
const LOSS_WINDOW: Duration = Duration::from_mins(5);
/// Longest time for which a job lets others go first while its kernels are compiled.
const MAX_COMPILE_WAIT: Duration = Duration::from_secs(30);
/// Waits before each attempt to open a lost device again.
const REOPEN_WAITS: [Duration; 3] = [Duration::ZERO, Duration::from_millis(500), Duration::from_secs(2)];

/// Starts the actor. The device is opened on its thread; follow [`RendererHandle::status`].
pub fn start(config: RendererConfig) -> std::io::Result<(RendererHandle, JoinHandle<()>)> {
    let (handle, commands, status) = RendererHandle::channel();
    let thread = std::thread::Builder::new().name("render".to_owned()).spawn(move || {
        Actor::new(config, commands, status).run();
    })?;
    Ok((handle, thread))
}

struct Session {
    scene: Arc<Scene>,
    lights: LightState,
    scene_rev: u32,
    /// Scene and light table on the device; made when first needed.
    on_device: Option<(Arc<SceneBuffers>, LightBuffers)>,
    /// What its views share.
    shared: SessionState,
}

struct Job {
    work: JobWork,
    progress: watch::Sender<JobProgress>,
    cancel: watch::Receiver<bool>,
    reply: Reply<RenderOutput>,
    used_secs: f64,
    /// When it left the queue.
    admitted_at: Option<Instant>,
}

enum JobWork {
    Waiting(Box<RenderJob>),
    Running(Box<RunningJob>),
}

impl Job {
    /// Whether a turn would do work rather than wait for a compiler.
    fn is_ready(&self, gpu: &Gpu) -> bool {
        match &self.work {
            JobWork::Running(_) => true,
            JobWork::Waiting(job) => {
                self.admitted_at.is_none_or(|at| at.elapsed() > MAX_COMPILE_WAIT)
                    || kernels_of(job).iter().all(|(name, features)| gpu.kernel_if_ready(name, *features).is_some())
            }
        }
    }
}

/// Who works next.
enum Turn {
    View(ViewKey),
    Job(usize),
}

struct Actor {
    config: RendererConfig,
    commands: CommandReceiver,
    status: watch::Sender<RendererStatus>,
    gpu: Option<Gpu>,
    store: SceneStore,
    sessions: BTreeMap<SessionKey, Session>,
    views: BTreeMap<ViewKey, RunningView>,
    running: Vec<Job>,
    queued: VecDeque<Job>,
    losses: VecDeque<Instant>,
    frame_count: u64,
    ray_count: u64,
    is_stopping: bool,
}

impl Actor {
    fn new(config: RendererConfig, commands: CommandReceiver, status: watch::Sender<RendererStatus>) -> Self {
        Self {
            config,
            commands,
            status,
            gpu: None,
            store: SceneStore::default(),
            sessions: BTreeMap::new(),
            views: BTreeMap::new(),
            running: Vec::new(),
            queued: VecDeque::new(),
            losses: VecDeque::new(),
            frame_count: 0,
            ray_count: 0,
            is_stopping: false,
        }
    }

    fn run(mut self) {
        self.open();
        while !self.is_stopping {
            self.take_commands();
            self.drop_abandoned();
            self.fill_running();
            if let Some(turn) = self.next_turn() {
                self.work(&turn);
            }
            self.publish();
        }
        for view in self.views.values() {
            view.slot.close();
        }
        for session in self.sessions.values() {
            self.save_surfels(session);
        }
        if let Some(gpu) = &self.gpu {
            gpu.stop_preparing();
        }
    }

    /// Takes all waiting commands; sleeps for one where there is nothing else to do.
    fn take_commands(&mut self) {
        if self.next_turn().is_none() && self.queued.is_empty() {
            self.publish();
            match self.commands.blocking_recv() {
                Some(command) => self.obey(command),
                None => self.is_stopping = true,
            }
        }
        loop {
            match self.commands.try_recv() {
                Ok(command) => self.obey(command),
                Err(mpsc::error::TryRecvError::Empty) => break,
                Err(mpsc::error::TryRecvError::Disconnected) => {
                    self.is_stopping = true;
                    break;
                }
            }
        }
    }

    fn obey(&mut self, command: Command) {
        match command {
            Command::OpenSession { session, scene, reply } => {
                let result = self.open_session(session, scene);
                let _ = reply.send(result);
            }
            Command::CloseSession { session } => {
                if let Some(closed) = self.sessions.remove(&session) {
                    self.save_surfels(&closed);
                }
                self.views.retain(|_, view| {
                    let stays = view.session != session;
                    if !stays {
                        view.slot.close();
                    }
                    stays
                });
            }
            Command::SetLights { session, lights, scene_rev } => {
                if let Some(state) = self.sessions.get_mut(&session) {
                    state.lights = lights;
                    state.scene_rev = scene_rev;
                    if let Some(gpu) = &self.gpu
                        && let Some((_, buffers)) = &mut state.on_device
                        && let Ok(new) = LightBuffers::new(gpu, &state.scene, &state.lights)
                    {
                        *buffers = new;
                    } else {
                        state.on_device = None;
                    }
                    state.shared.invalidate(Change::Lights);
                    for view in self.views.values_mut().filter(|view| view.session == session) {
                        view.relight();
                    }
                }
            }
            Command::OpenView { session, view, state, slot, reply } => {
                let result = if !self.sessions.contains_key(&session) {
                    Err(RendererError::Unknown("the session"))
                } else if registry::by_id(&state.technique).is_none() {
                    Err(RendererError::Unsupported(format!("technique `{}` is not known", state.technique)))
                } else {
                    let used_secs = self.least_used();
                    self.views.insert(view, RunningView::new(session, state, slot, used_secs));
                    Ok(())
                };
                let _ = reply.send(result);
            }
            Command::UpdateView { view, state } => {
                if let Some(view) = self.views.get_mut(&view)
                    && registry::by_id(&state.technique).is_some()
                {
                    view.update(*state);
                }
            }
            Command::CloseView { view } => {
                if let Some(view) = self.views.remove(&view) {
                    view.slot.close();
                }
            }
            Command::Pick { session, camera, aspect, point, reply } => {
                let result = match self.sessions.get(&session) {
                    Some(session) => Ok(pick(&session.scene, &camera, aspect, point)),
                    None => Err(RendererError::Unknown("the session")),
                };
                let _ = reply.send(result);
            }
            Command::Inspect { session, camera, size, point, reply } => {
                let result = self.inspect(session, camera, size, point);
                let _ = reply.send(result);
            }
            Command::Render { job, progress, cancel, reply } => self.enqueue(job, progress, cancel, reply),
            Command::Wake => {}
            Command::LoseDevice => {
                if let Some(gpu) = &self.gpu
                    && let Err(error) = gpu.force_loss()
                {
                    tracing::warn!(%error, "the device was not given up");
                } else {
                    self.recover();
                }
            }
            Command::Stop => self.is_stopping = true,
        }
    }

    fn open_session(&mut self, session: SessionKey, scene: Arc<Scene>) -> Result<(), RendererError> {
        let Some(gpu) = &self.gpu else { return Err(RendererError::DeviceLost) };
        self.store.admit(gpu, &scene)?;
        let lights = LightState::of_scene(&scene);
        let shared = SessionState::default();
        if let Some(folder) = &self.config.snapshot_dir {
            snapshots::offer(folder, &scene, &lights, &shared);
        }
        self.sessions.insert(session, Session { scene, lights, scene_rev: 0, on_device: None, shared });
        Ok(())
    }

    /// Keeps a session's surfels for the next time its scene is opened.
    fn save_surfels(&self, session: &Session) {
        if let (Some(folder), Some(gpu)) = (&self.config.snapshot_dir, &self.gpu) {
            snapshots::save(folder, gpu, &session.scene, &session.lights, &session.shared);
        }
    }

    /// What the session's surfel cache knows of a point.
    fn inspect(
        &mut self,
        key: SessionKey,
        camera: Camera,
        size: [u32; 2],
        point: [f32; 2],
    ) -> Result<Option<Inspection>, RendererError> {
        let Some(gpu) = self.gpu.clone() else { return Err(RendererError::DeviceLost) };
        let Some(session) = self.sessions.get_mut(&key) else { return Err(RendererError::Unknown("the session")) };
        on_device(&gpu, &mut self.store, session)?;
        let (Some((scene, lights)), Some(cache)) = (&session.on_device, session.shared.surfels()) else {
            return Ok(None);
        };
        inspection::inspect(&gpu, scene, lights, &cache.lock(), FrameView { camera, size, exposure: 1.0 }, point)
    }

    fn enqueue(
        &mut self,
        job: Box<RenderJob>,
        progress: watch::Sender<JobProgress>,
        cancel: watch::Receiver<bool>,
        reply: Reply<RenderOutput>,
    ) {
        if self.gpu.is_none() {
            let _ = reply.send(Err(RendererError::DeviceLost));
        } else if self.queued.len() >= self.config.max_queued_jobs {
            let _ = reply.send(Err(RendererError::Busy { what: "jobs", limit: self.config.max_queued_jobs }));
        } else {
            let work = JobWork::Waiting(job);
            self.queued.push_back(Job { work, progress, cancel, reply, used_secs: 0.0, admitted_at: None });
        }
    }

    /// Drops jobs whose askers have gone.
    fn drop_abandoned(&mut self) {
        self.queued.retain(|job| !job.reply.is_closed());
        self.running.retain(|job| !job.reply.is_closed());
    }

    /// Starts waiting jobs while there is room.
    fn fill_running(&mut self) {
        while self.running.len() < self.config.max_running_jobs {
            let Some(mut job) = self.queued.pop_front() else { return };
            job.used_secs = self.least_used();
            job.admitted_at = Some(Instant::now());
            if let (Some(gpu), JobWork::Waiting(waiting)) = (&self.gpu, &job.work) {
                // Frames of views do not wait while a job's kernels are compiled.
                for (name, features) in kernels_of(waiting) {
                    gpu.prepare(name, features);
                }
            }
            self.running.push(job);
        }
    }

    /// Device time of whoever used least: where a newcomer starts, so that it neither waits nor takes over.
    fn least_used(&self) -> f64 {
        let views = self.views.values().map(|view| view.used_secs);
        let jobs = self.running.iter().map(|job| job.used_secs);
        views.chain(jobs).reduce(f64::min).unwrap_or(0.0)
    }

    fn next_turn(&self) -> Option<Turn> {
        let gpu = self.gpu.as_ref()?;
        let awake = || self.views.iter().filter(|(_, view)| view.wants_step());
        let by_use =
            |a: &(&ViewKey, &RunningView), b: &(&ViewKey, &RunningView)| a.1.used_secs.total_cmp(&b.1.used_secs);
        if let Some((key, _)) = awake().filter(|(_, view)| view.is_moving()).min_by(by_use) {
            return Some(Turn::View(*key));
        }
        let still = awake().min_by(by_use).map(|(key, view)| (*key, view.used_secs));
        // A job whose kernels are still being compiled lets others go first; alone it waits for them.
        let is_next = |index: &usize| still.is_none() || self.running[*index].is_ready(gpu);
        let by_job_use = |a: &usize, b: &usize| self.running[*a].used_secs.total_cmp(&self.running[*b].used_secs);
        let job = (0..self.running.len()).filter(is_next).min_by(by_job_use);
        match (still, job) {
            (Some((key, used)), Some(index)) if used <= self.running[index].used_secs => Some(Turn::View(key)),
            (_, Some(index)) => Some(Turn::Job(index)),
            (Some((key, _)), None) => Some(Turn::View(key)),
            (None, None) => None,
        }
    }

    fn work(&mut self, turn: &Turn) {
        match turn {
            Turn::View(key) => self.step_view(*key),
            Turn::Job(index) => self.step_job(*index),
        }
    }

    fn step_view(&mut self, key: ViewKey) {
        let Some(gpu) = self.gpu.clone() else { return };
        let Some(view) = self.views.get_mut(&key) else { return };
        let Some(session) = self.sessions.get_mut(&view.session) else {
            self.views.remove(&key);
            return;
        };
        let result = on_device(&gpu, &mut self.store, session).and_then(|()| {
            let Some((scene, lights)) = &session.on_device else { return Ok(false) };
            view.step(&gpu, scene, lights, &session.shared, session.scene_rev)
        });
        self.ray_count += view.take_rays();
        match result {
            Ok(is_frame) => self.frame_count += u64::from(is_frame),
            Err(RendererError::DeviceLost) => self.recover(),
            Err(error) => {
                tracing::error!(%error, "a view was closed");
                view.slot.close();
                self.views.remove(&key);
            }
        }
    }

    fn step_job(&mut self, index: usize) {
        let Some(gpu) = self.gpu.clone() else { return };
        let job = &mut self.running[index];
        let started = Instant::now();
        let is_canceled = *job.cancel.borrow();
        let result = match &mut job.work {
            JobWork::Waiting(_) if is_canceled => Err(RendererError::Canceled),
            JobWork::Waiting(waiting) => RunningJob::start(&gpu, &mut self.store, (**waiting).clone()).map(|running| {
                job.work = JobWork::Running(Box::new(running));
                None
            }),
            JobWork::Running(running) => running.step(&gpu, is_canceled).map(|state| match state {
                JobState::Running => {
                    job.progress.send_replace(running.progress());
                    None
                }
                JobState::Done(output) => Some(output),
            }),
        };
        job.used_secs += started.elapsed().as_secs_f64();
        match result {
            Ok(None) => {}
            Ok(Some(output)) => {
                let job = self.running.swap_remove(index);
                let rays = output.rays;
                self.ray_count += rays.primary + rays.secondary + rays.shadow;
                let _ = job.reply.send(Ok(*output));
            }
            Err(RendererError::DeviceLost) => self.recover(),
            Err(error) => {
                let job = self.running.swap_remove(index);
                let _ = job.reply.send(Err(error));
            }
        }
    }

    /// Opens the device for the first time or again.
    fn open(&mut self) {
        let options = GpuOptions {
            adapter: self.config.adapter.clone(),
            cache_dir: self.config.cache_dir.clone(),
            memory_budget_bytes: self.config.memory_budget_bytes,
            allow_forced_loss: self.config.allow_forced_loss,
            ..GpuOptions::default()
        };
        for wait in REOPEN_WAITS {
            std::thread::sleep(wait);
            match Gpu::open(&options) {
                Ok(gpu) => {
                    if self.config.prepares_general_kernels && !gpu.compiles_when_run() {
                        // They compile while the first scene is still being read.
                        let techniques =
                            registry::TECHNIQUES.iter().flat_map(|entry| (entry.kernels)(&SurfelSettings::default()));
                        for kernel in techniques.chain(["error_audit"]) {
                            gpu.prepare(kernel, general_features(MaterialMode::Pbr, false));
                        }
                    }
                    self.gpu = Some(gpu);
                    self.set_state(DeviceState::Ready);
                    return;
                }
                Err(error) => tracing::error!(%error, "the render device could not be opened"),
            }
        }
        self.fail();
    }

    /// The device is gone: everything on it is dropped and made again from what the host holds.
    fn recover(&mut self) {
        tracing::warn!("the render device was lost");
        if let Some(gpu) = self.gpu.take() {
            gpu.stop_preparing();
        }
        self.store.clear();
        for session in self.sessions.values_mut() {
            session.on_device = None;
            session.shared = SessionState::default();
        }
        for view in self.views.values_mut() {
            view.drop_work();
        }
        for job in &mut self.running {
            if let JobWork::Running(running) = &mut job.work {
                // Jobs are deterministic, so starting over costs time and nothing else.
                job.work = JobWork::Waiting(Box::new(running.job().clone()));
            }
        }
        self.set_state(DeviceState::Lost);
        self.status.send_modify(|status| status.device_lost_count += 1);
        let now = Instant::now();
        self.losses.retain(|at| now.duration_since(*at) < LOSS_WINDOW);
        self.losses.push_back(now);
        if self.losses.len() >= MAX_LOSSES {
            self.fail();
            return;
        }
        self.open();
        self.status.send_modify(|status| status.epoch += 1);
    }

    fn fail(&mut self) {
        tracing::error!("no render device; restart the server once `surfelcast doctor` finds one");
        self.set_state(DeviceState::Failed);
        for view in std::mem::take(&mut self.views).into_values() {
            view.slot.close();
        }
        for job in std::mem::take(&mut self.running).into_iter().chain(std::mem::take(&mut self.queued)) {
            let _ = job.reply.send(Err(RendererError::DeviceLost));
        }
    }

    fn set_state(&mut self, state: DeviceState) {
        let device = self.gpu.as_ref().map(|gpu| {
            let info = gpu.info();
            DeviceInfo {
                name: info.name.clone(),
                kind: info.kind.to_string(),
                driver: info.driver.clone(),
                backend: info.backend.clone(),
            }
        });
        self.status.send_modify(|status| {
            status.state = state;
            if let Some(device) = device {
                status.device = device;
            }
            status.techniques = registry::TECHNIQUES
                .iter()
                .map(|entry| TechniqueDescription {
                    id: entry.id,
                    label: entry.label,
                    summary: entry.summary,
                    uses_surfels: entry.uses_surfels,
                })
                .collect();
        });
    }

    fn publish(&self) {
        let memory = self.gpu.as_ref().map(Gpu::memory).unwrap_or_default();
        self.status.send_if_modified(|status| {
            let before = status.clone();
            status.session_count = self.sessions.len() as u32;
            status.view_count = self.views.len() as u32;
            status.idle_view_count = self.views.values().filter(|view| view.is_idle()).count() as u32;
            status.queued_job_count = (self.queued.len() + self.running.len()) as u32;
            status.memory_used_bytes = memory.total_bytes();
            status.memory_budget_bytes = memory.budget_bytes;
            status.frame_count = self.frame_count;
            status.ray_count = self.ray_count;
            *status != before
        });
    }
}

/// Makes sure that a session's scene and lights are on the device.
fn on_device(gpu: &Gpu, store: &mut SceneStore, session: &mut Session) -> Result<(), RendererError> {
    if session.on_device.is_none() {
        let scene = store.get(gpu, &session.scene)?;
        let lights = LightBuffers::new(gpu, &session.scene, &session.lights)?;
        session.on_device = Some((scene, lights));
    }
    Ok(())
}

/// Traces one ray on the host: cheaper than asking the device.
fn pick(scene: &Scene, camera: &Camera, aspect: f64, point: [f32; 2]) -> Option<Picked> {
    let (right, up, forward) = camera.frame();
    let half_height = (camera.vfov * 0.5).tan();
    let x = (f64::from(point[0]) * 2.0 - 1.0) * half_height * aspect;
    let y = (1.0 - f64::from(point[1]) * 2.0) * half_height;
    let direction = (forward + right * x + up * y).normalize_or(forward);
    let origin = (camera.position - scene.origin).as_vec3();
    let hit = surfelcast_scene::trace::closest_hit(&scene.geometry, origin, direction.as_vec3(), 0.0, f32::MAX)?;
    let triangle = scene.geometry.bvh_triangles.get(hit.bvh_triangle as usize)?;
    let geometry = scene.geometry.geometries.get(triangle.geometry as usize)?;
    let instance = scene.geometry.instances.get(hit.instance as usize)?;
    let is_baked = scene.geometry.baked_instance == Some(hit.instance);
    let node = if is_baked { geometry.node } else { instance.node };
    Some(Picked {
        position: camera.position + direction * f64::from(hit.t),
        object: scene.node_names.get(node as usize).cloned().unwrap_or_default(),
    })
}
