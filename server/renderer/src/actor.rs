//! The render actor: one thread that owns the device and shares its time.
//!
//! Its loop handles all waiting commands, chooses who works next (`scheduler.rs`) and runs one short step. Without work
//! it sleeps on its channel.

use std::collections::BTreeMap;
use std::sync::Arc;
use std::thread::JoinHandle;
use std::time::Instant;

use surfelcast_gpu::Gpu;
use surfelcast_render_api::Inspection;
use surfelcast_scene::{Camera, Scene};
use surfelcast_techniques::{TechniqueEntry, registry};
use tokio::sync::{mpsc, watch};

use crate::command::{Command, CommandReceiver, SessionKey, ViewKey};
use crate::config::RendererConfig;
use crate::device_life::{self, AfterLoss, LossLog};
use crate::error::RendererError;
use crate::handle::RendererHandle;
use crate::running_view::RunningView;
use crate::scenes::SceneStore;
use crate::scheduler::{JobLoad, JobQueue, ViewLoad, Worker, least_used, next_worker};
use crate::session::Session;
use crate::status::{DeviceInfo, DeviceState, RendererStatus};
use crate::submitted_job::SubmittedJob;

/// Starts the actor. The device is opened on its thread; follow [`RendererHandle::status`].
pub fn start(config: RendererConfig) -> std::io::Result<(RendererHandle, JoinHandle<()>)> {
    let (handle, commands, status) = RendererHandle::channel();
    let thread = std::thread::Builder::new().name("render".to_owned()).spawn(move || {
        Actor::new(config, commands, status).run();
    })?;
    Ok((handle, thread))
}

struct Actor {
    config: RendererConfig,
    commands: CommandReceiver,
    status: watch::Sender<RendererStatus>,
    gpu: Option<Gpu>,
    store: SceneStore,
    sessions: BTreeMap<SessionKey, Session>,
    views: BTreeMap<ViewKey, RunningView>,
    jobs: JobQueue<SubmittedJob>,
    losses: LossLog,
    frame_count: u64,
    ray_count: u64,
    is_stopping: bool,
}

impl Actor {
    fn new(config: RendererConfig, commands: CommandReceiver, status: watch::Sender<RendererStatus>) -> Self {
        Self {
            jobs: JobQueue::new(config.max_queued_jobs, config.max_running_jobs),
            config,
            commands,
            status,
            gpu: None,
            store: SceneStore::default(),
            sessions: BTreeMap::new(),
            views: BTreeMap::new(),
            losses: LossLog::default(),
            frame_count: 0,
            ray_count: 0,
            is_stopping: false,
        }
    }

    fn run(mut self) {
        let catalogue = Arc::new(registry::catalogue(self.config.techniques));
        self.status.send_modify(|status| status.catalogue = catalogue);
        if !self.open() {
            self.fail();
        }
        while !self.is_stopping {
            self.take_commands();
            self.jobs.retain(|job| !job.is_abandoned());
            self.admit_jobs();
            match self.next_worker() {
                Some(Worker::View(key)) => self.step_view(key),
                Some(Worker::Job(index)) => self.step_job(index),
                None => {}
            }
            self.publish();
        }
        for view in self.views.values() {
            view.slot.close();
        }
        for session in self.sessions.values() {
            self.save(session);
        }
        if let Some(gpu) = &self.gpu {
            gpu.stop_preparing();
        }
    }

    /// Handles all waiting commands; sleeps until one comes where there is no work.
    fn take_commands(&mut self) {
        if self.next_worker().is_none() && !self.jobs.is_any_waiting() {
            self.publish();
            match self.commands.blocking_recv() {
                Some(command) => self.handle(command),
                None => self.is_stopping = true,
            }
        }
        loop {
            match self.commands.try_recv() {
                Ok(command) => self.handle(command),
                Err(mpsc::error::TryRecvError::Empty) => break,
                Err(mpsc::error::TryRecvError::Disconnected) => {
                    self.is_stopping = true;
                    break;
                }
            }
        }
    }

    fn handle(&mut self, command: Command) {
        match command {
            Command::OpenSession { session, scene, reply } => {
                let result = self.open_session(session, scene);
                let _ = reply.send(result);
            }
            Command::CloseSession { session } => {
                if let Some(closed) = self.sessions.remove(&session) {
                    self.save(&closed);
                }
                self.views.retain(|_, view| {
                    let stays = view.session != session;
                    if !stays {
                        view.slot.close();
                    }
                    stays
                });
            }
            Command::EditScene { session, edit, scene_rev } => {
                if let Some(edited) = self.sessions.get_mut(&session) {
                    let change = edited.edit(self.gpu.as_ref(), edit, scene_rev);
                    for view in self.views.values_mut().filter(|view| view.session == session) {
                        view.invalidate(change);
                    }
                }
            }
            Command::OpenView { session, view, state, slot, reply } => {
                let result = if self.sessions.contains_key(&session) {
                    self.technique(&state.technique).map(|_| {
                        let used_secs = self.least_used();
                        let running = RunningView::new(self.config.techniques, session, state, slot, used_secs);
                        self.views.insert(view, running);
                    })
                } else {
                    Err(RendererError::Unknown("the session"))
                };
                let _ = reply.send(result);
            }
            Command::UpdateView { view, state } => {
                let is_known = self.technique(&state.technique).is_ok();
                if let Some(view) = self.views.get_mut(&view).filter(|_| is_known) {
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
                    Some(session) => Ok(session.scene.pick(&camera, aspect, point)),
                    None => Err(RendererError::Unknown("the session")),
                };
                let _ = reply.send(result);
            }
            Command::Inspect { session, camera, size, point, reply } => {
                let result = self.inspect(session, camera, size, point);
                let _ = reply.send(result);
            }
            Command::Render { job, progress, cancel, reply } => match self.technique(&job.spec.technique) {
                Ok(entry) => self.submit(SubmittedJob::new(entry, job, progress, cancel, reply)),
                Err(error) => drop(reply.send(Err(error))),
            },
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
        self.sessions.insert(session, Session::new(scene, self.config.techniques, self.config.snapshot_dir.as_deref()));
        Ok(())
    }

    /// The technique of an id or alias.
    fn technique(&self, id: &str) -> Result<&'static TechniqueEntry, RendererError> {
        let found = registry::find(self.config.techniques, id).map(|(entry, _)| entry);
        found.ok_or_else(|| RendererError::Unsupported(format!("technique `{id}` is not known")))
    }

    /// Saves what techniques keep of a session for the next session of its scene.
    fn save(&self, session: &Session) {
        if let (Some(folder), Some(gpu)) = (&self.config.snapshot_dir, &self.gpu) {
            session.save(gpu, folder);
        }
    }

    /// What a technique of the session knows of a point.
    fn inspect(
        &mut self,
        key: SessionKey,
        camera: Camera,
        size: [u32; 2],
        point: [f32; 2],
    ) -> Result<Option<Inspection>, RendererError> {
        let Some(gpu) = self.gpu.clone() else { return Err(RendererError::DeviceLost) };
        let Some(session) = self.sessions.get_mut(&key) else { return Err(RendererError::Unknown("the session")) };
        session.inspect(&gpu, &mut self.store, camera, size, point)
    }

    fn submit(&mut self, job: SubmittedJob) {
        if self.gpu.is_none() {
            job.answer(Err(RendererError::DeviceLost));
        } else if let Err(job) = self.jobs.submit(job) {
            job.answer(Err(RendererError::Busy { what: "jobs", limit: self.config.max_queued_jobs }));
        }
    }

    /// Admits waiting jobs while there is room.
    fn admit_jobs(&mut self) {
        let used_secs = self.least_used();
        while let Some(job) = self.jobs.admit(used_secs, Instant::now()) {
            if let Some(gpu) = &self.gpu {
                job.prepare(gpu);
            }
        }
    }

    fn least_used(&self) -> f64 {
        let views = self.views.values().map(|view| view.used_secs);
        least_used(views.chain(self.jobs.admitted().iter().map(|job| job.used_secs)))
    }

    fn next_worker(&self) -> Option<Worker> {
        let gpu = self.gpu.as_ref()?;
        let now = Instant::now();
        let view_load = |(&key, view): (&ViewKey, &RunningView)| {
            let (is_moving, wants_step) = (view.is_moving(), view.wants_step());
            ViewLoad { key, used_secs: view.used_secs, is_moving, wants_step }
        };
        let views: Vec<ViewLoad> = self.views.iter().map(view_load).collect();
        let jobs: Vec<JobLoad> =
            self.jobs.admitted().iter().map(|admitted| admitted.load(admitted.job.is_compiled(gpu), now)).collect();
        next_worker(&views, &jobs)
    }

    fn step_view(&mut self, key: ViewKey) {
        let Some(gpu) = self.gpu.clone() else { return };
        let Some(view) = self.views.get_mut(&key) else { return };
        let Some(session) = self.sessions.get_mut(&view.session) else {
            self.views.remove(&key);
            return;
        };
        let scene_rev = session.scene_rev;
        let on_device = session.on_device(&gpu, &mut self.store);
        let result = on_device.and_then(|(on, shared)| view.step(on, shared, scene_rev));
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
        let Some(admitted) = self.jobs.admitted_mut().get_mut(index) else { return };
        let started = Instant::now();
        let result = admitted.job.step(&gpu, &mut self.store);
        admitted.used_secs += started.elapsed().as_secs_f64();
        match result {
            Ok(None) => {}
            Ok(Some(output)) => {
                let rays = output.rays;
                self.ray_count += rays.primary + rays.secondary + rays.shadow;
                self.jobs.take(index).answer(Ok(*output));
            }
            Err(RendererError::DeviceLost) => self.recover(),
            Err(error) => self.jobs.take(index).answer(Err(error)),
        }
    }

    /// Opens the device for the first time or again. Returns whether there is one.
    fn open(&mut self) -> bool {
        self.gpu = device_life::open(&self.config);
        if self.gpu.is_some() {
            self.set_state(DeviceState::Ready);
        }
        self.gpu.is_some()
    }

    /// The device is lost: drops everything on it, to be created again from the data on the host.
    fn recover(&mut self) {
        tracing::warn!("the render device was lost");
        if let Some(gpu) = self.gpu.take() {
            gpu.stop_preparing();
        }
        self.store.clear();
        self.sessions.values_mut().for_each(Session::forget_device);
        self.views.values_mut().for_each(RunningView::forget_device);
        self.jobs.admitted_mut().iter_mut().for_each(|admitted| admitted.job.start_over());
        self.set_state(DeviceState::Lost);
        self.status.send_modify(|status| status.device_lost_count += 1);
        if self.losses.record(Instant::now()) == AfterLoss::Reopen && self.open() {
            self.status.send_modify(|status| status.epoch += 1);
        } else {
            self.fail();
        }
    }

    /// The device is given up: closes the views and answers the jobs, which may be sent again to another server or
    /// after a restart.
    fn fail(&mut self) {
        tracing::error!("no render device; restart the server once `surfelcast doctor` finds one");
        self.set_state(DeviceState::Failed);
        for view in std::mem::take(&mut self.views).into_values() {
            view.slot.close();
        }
        self.jobs.take_all().for_each(|job| job.answer(Err(RendererError::DeviceLost)));
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
        });
    }

    fn publish(&self) {
        let memory = self.gpu.as_ref().map(Gpu::memory).unwrap_or_default();
        self.status.send_if_modified(|status| {
            let before = status.clone();
            status.session_count = self.sessions.len() as u32;
            status.view_count = self.views.len() as u32;
            status.idle_view_count = self.views.values().filter(|view| view.is_idle()).count() as u32;
            status.queued_job_count = self.jobs.len() as u32;
            status.memory_used_bytes = memory.total_bytes();
            status.memory_budget_bytes = memory.budget_bytes;
            status.frame_count = self.frame_count;
            status.ray_count = self.ray_count;
            *status != before
        });
    }
}
