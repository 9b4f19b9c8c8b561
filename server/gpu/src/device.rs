//! The device: opening it, its memory, its loss.

use std::fmt;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, OnceLock};
use std::time::Duration;

use parking_lot::Mutex;
use surfelcast_shaders::Features;

use crate::adapter::{self, AdapterKind, AdapterReport, GpuLimits, Tier};
use crate::error::GpuError;
use crate::kernel::{Kernel, KernelStore};
use crate::memory::{Buffer, BufferInner, MemoryKind, MemoryLedger, MemoryUse, next_id};
use crate::pipeline_cache;
use crate::staging::StagingRing;
use crate::tracker::{ErrorTracker, TrackedError};
use crate::wait::ready;

/// Bytes passed to the driver at once when uploading, so that its own staging stays small.
const UPLOAD_CHUNK_BYTES: usize = 16 << 20;
/// Default budget of a graphics card: wgpu does not report how much memory it has.
const DEFAULT_BUDGET_BYTES: u64 = 4 << 30;
/// Default time after which an unfinished submission counts as a hanging driver.
const DEFAULT_SUBMISSION_LIMIT: Duration = Duration::from_secs(30);
/// The same for CPU devices, which compile at the first dispatch and share the cores with other processes: the limit
/// for cards was observed to fail on a busy machine.
const CPU_SUBMISSION_LIMIT: Duration = Duration::from_mins(5);

/// How passes are timed, which determines how they are submitted.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PassTiming {
    /// Each pass is a submission of its own, timed around submitting and waiting.
    WallClock,
    /// One submission with timestamps around each pass; no times where the device has no timestamps.
    Timestamps,
}

/// How to open the device.
#[derive(Clone, Debug, Default)]
pub struct GpuOptions {
    /// Index of the adapter or part of its name; the best usable one otherwise.
    pub adapter: Option<String>,
    /// Where compiled pipelines are kept over restarts; nowhere otherwise.
    pub cache_dir: Option<PathBuf>,
    /// Most bytes to use. Half of the machine's memory on CPU devices and 4 GiB on others otherwise.
    pub memory_budget_bytes: Option<u64>,
    /// Wall clock on CPU devices, whose timestamps mean nothing, and timestamps on others otherwise.
    pub pass_timing: Option<PassTiming>,
    /// Longest time to wait for submitted work before the device counts as lost; 30 seconds otherwise, 300 on CPU
    /// devices.
    pub submission_limit: Option<Duration>,
    /// Lets [`Gpu::force_loss`] work. For tests.
    pub allow_forced_loss: bool,
}

/// An open device. Clones share it.
#[derive(Clone)]
pub struct Gpu {
    pub(crate) inner: Arc<Inner>,
}

pub(crate) struct Inner {
    pub(crate) device: wgpu::Device,
    pub(crate) queue: wgpu::Queue,
    pub(crate) id: u64,
    pub(crate) report: AdapterReport,
    pub(crate) timing: PassTiming,
    /// Whether passes are timed by timestamps and the device has them.
    pub(crate) has_timestamps: bool,
    /// Whether every pass has an error scope of its own.
    pub(crate) checks_passes: bool,
    pub(crate) submission_limit: Duration,
    pub(crate) ledger: Arc<MemoryLedger>,
    pub(crate) kernels: KernelStore,
    pub(crate) staging: StagingRing,
    /// Uniform data of the graph being submitted. Also held while submitting: the data and the passes that read it
    /// must reach the queue together.
    pub(crate) uniforms: Mutex<Option<wgpu::Buffer>>,
    pub(crate) pipeline_cache: Option<(PathBuf, wgpu::PipelineCache)>,
    /// Format of what raster kernels draw into, or why none can run.
    pub(crate) target_format: Result<wgpu::TextureFormat, String>,
    loss: Arc<Loss>,
    errors: Arc<ErrorTracker>,
    allows_forced_loss: bool,
}

/// Whether the device is lost, and why. The first reason is kept.
#[derive(Default)]
struct Loss {
    reason: OnceLock<String>,
    lost: AtomicBool,
}

impl Loss {
    fn mark(&self, reason: &str) {
        let _ = self.reason.set(reason.to_owned());
        self.lost.store(true, Ordering::Release);
    }
}

impl Gpu {
    /// Opens the adapter that `options` name, or the best usable one: cards before integrated before virtual before
    /// software.
    pub fn open(options: &GpuOptions) -> Result<Gpu, GpuError> {
        let (report, adapter) = adapter::choose(options.adapter.as_deref())?;
        let open_failed = |message: String| GpuError::Open { adapter: report.name.clone(), message };
        let is_cpu = report.kind == AdapterKind::Cpu;
        let wanted = wgpu::Features::SUBGROUP
            | wgpu::Features::PIPELINE_CACHE
            | wgpu::Features::TIMESTAMP_QUERY
            | wgpu::Features::FLOAT32_BLENDABLE;
        let mut features = adapter.features() & wanted;
        let default_timing = if is_cpu { PassTiming::WallClock } else { PassTiming::Timestamps };
        let timing = options.pass_timing.unwrap_or(default_timing);
        features.set(
            wgpu::Features::TIMESTAMP_QUERY,
            timing == PassTiming::Timestamps && features.contains(wgpu::Features::TIMESTAMP_QUERY),
        );
        let descriptor = wgpu::DeviceDescriptor {
            label: Some("surfelcast"),
            required_features: features,
            required_limits: adapter.limits(),
            ..wgpu::DeviceDescriptor::default()
        };
        let (device, queue) = ready(adapter.request_device(&descriptor))
            .ok_or_else(|| open_failed("the driver did not answer".to_owned()))?
            .map_err(|error| open_failed(error.to_string()))?;

        let loss = Arc::new(Loss::default());
        let errors = Arc::new(ErrorTracker::default());
        device.on_uncaptured_error(Arc::new({
            let errors = Arc::clone(&errors);
            move |error: wgpu::Error| errors.report(&error.to_string())
        }));
        device.set_device_lost_callback({
            let loss = Arc::clone(&loss);
            move |reason, message| match reason {
                wgpu::DeviceLostReason::Destroyed => loss.mark("it was closed"),
                wgpu::DeviceLostReason::Unknown => loss.mark(&message),
            }
        });

        let pipeline_cache =
            options.cache_dir.as_ref().filter(|_| features.contains(wgpu::Features::PIPELINE_CACHE)).map(|directory| {
                open_pipeline_cache(&device, pipeline_cache::file_path(directory, &adapter.get_info()))
            });
        let budget = options
            .memory_budget_bytes
            .unwrap_or_else(|| if is_cpu { half_of_system_memory() } else { DEFAULT_BUDGET_BYTES });
        tracing::info!(
            target: "surfelcast::gpu",
            adapter = report.name, kind = %report.kind, driver = report.driver, tier = %report.tier, budget,
            "device opened"
        );
        let inner = Inner {
            device,
            queue,
            id: next_id(),
            timing,
            has_timestamps: features.contains(wgpu::Features::TIMESTAMP_QUERY),
            checks_passes: cfg!(debug_assertions)
                || std::env::var_os("SURFELCAST_GPU_CHECKS").is_some_and(|v| v == "1"),
            submission_limit: options.submission_limit.unwrap_or(if is_cpu {
                CPU_SUBMISSION_LIMIT
            } else {
                DEFAULT_SUBMISSION_LIMIT
            }),
            ledger: Arc::new(MemoryLedger::new(budget)),
            kernels: KernelStore::default(),
            staging: StagingRing::default(),
            uniforms: Mutex::new(None),
            pipeline_cache,
            target_format: adapter::target_format(&adapter),
            loss,
            errors,
            allows_forced_loss: options.allow_forced_loss,
            report,
        };
        Ok(Gpu { inner: Arc::new(inner) })
    }

    /// The adapter of the device.
    pub fn info(&self) -> &AdapterReport {
        &self.inner.report
    }

    /// Whether the device is a software renderer.
    pub fn is_cpu(&self) -> bool {
        self.inner.report.kind == AdapterKind::Cpu
    }

    /// Whether the driver compiles a kernel when it first runs, whenever it was requested, as software renderers do:
    /// then preparing one while another serves gains nothing.
    pub fn compiles_when_run(&self) -> bool {
        self.is_cpu()
    }

    /// Limits.
    pub fn limits(&self) -> &GpuLimits {
        &self.inner.report.limits
    }

    /// Tier.
    pub fn tier(&self) -> Tier {
        self.inner.report.tier
    }

    /// Bytes in use and the budget.
    pub fn memory(&self) -> MemoryUse {
        self.inner.ledger.current()
    }

    /// Errors that reached no caller, each once.
    pub fn errors(&self) -> Vec<TrackedError> {
        self.inner.errors.errors()
    }

    /// Whether the device is lost.
    pub fn is_lost(&self) -> bool {
        self.inner.loss.lost.load(Ordering::Acquire)
    }

    /// Links and compiles the kernel, or returns it at once when that was done before.
    pub fn kernel(&self, name: &str, features: Features) -> Result<Kernel, GpuError> {
        self.inner.check()?;
        self.inner.kernels.get(&self.inner, name, features)
    }

    /// Ends background compilation and waits for the kernel being compiled; call before the process ends.
    pub fn stop_preparing(&self) {
        self.inner.kernels.stop();
    }

    /// Compiles a kernel given as WESL text instead of by name. For tests and tools.
    pub fn kernel_from_source(&self, name: &str, text: &str, features: Features) -> Result<Kernel, GpuError> {
        self.inner.check()?;
        self.inner.kernels.compile_source(&self.inner, name, text, features)
    }

    /// Starts to compile the kernel in the background, unless that was done before. Does not wait.
    pub fn prepare(&self, name: &str, features: Features) {
        if !self.is_lost() {
            self.inner.kernels.prepare(&self.inner, name, features);
        }
    }

    /// The kernel, if it has been compiled. A kernel whose compilation failed is never ready; [`Gpu::kernel`] returns
    /// the error.
    pub fn kernel_if_ready(&self, name: &str, features: Features) -> Option<Kernel> {
        self.inner.kernels.if_ready(name, features)
    }

    /// Allocates a buffer of zeros. Fails before the driver is called where the budget is exceeded.
    pub fn buffer(&self, label: &str, kind: MemoryKind, size_bytes: u64) -> Result<Buffer, GpuError> {
        self.make_buffer(label, kind, size_bytes, false)
    }

    /// As [`Gpu::buffer`], for a buffer that a dispatch can take its size from.
    pub fn indirect_buffer(&self, label: &str, kind: MemoryKind, size_bytes: u64) -> Result<Buffer, GpuError> {
        self.make_buffer(label, kind, size_bytes, true)
    }

    fn make_buffer(&self, label: &str, kind: MemoryKind, size: u64, indirect: bool) -> Result<Buffer, GpuError> {
        let inner = &self.inner;
        inner.check()?;
        let limit = self.limits().buffer_bytes.min(self.limits().storage_binding_bytes);
        // Rounded up to whole vectors, so that an empty list is a valid buffer and copies are aligned.
        let rounded = size.max(1).checked_next_multiple_of(16).filter(|&rounded| rounded <= limit);
        let Some(size_bytes) = rounded else {
            return Err(GpuError::TooLarge { field: label.to_owned(), needed: size, limit });
        };
        let admission = inner.ledger.admit(label, kind, size_bytes)?;
        let mut usage = wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_SRC | wgpu::BufferUsages::COPY_DST;
        usage.set(wgpu::BufferUsages::INDIRECT, indirect);
        let raw = inner.scoped(label, size_bytes, || {
            inner.device.create_buffer(&wgpu::BufferDescriptor {
                label: Some(label),
                size: size_bytes,
                usage,
                mapped_at_creation: false,
            })
        })?;
        Ok(Buffer {
            inner: Arc::new(BufferInner {
                raw,
                label: label.to_owned(),
                kind,
                size_bytes,
                indirect,
                id: next_id(),
                device_id: inner.id,
                written: AtomicBool::new(false),
                _admission: admission,
            }),
        })
    }

    /// Copies `bytes` to the buffer at `offset`, both multiples of four, before anything submitted later runs.
    pub fn upload(&self, buffer: &Buffer, offset: u64, bytes: &[u8]) -> Result<(), GpuError> {
        let inner = &self.inner;
        inner.check()?;
        let refuse =
            |message: String| Err(GpuError::Validation { context: format!("upload to `{}`", buffer.label()), message });
        if buffer.inner.device_id != inner.id {
            return refuse("the buffer belongs to another device".to_owned());
        }
        if !offset.is_multiple_of(4) || !bytes.len().is_multiple_of(4) {
            return refuse(format!("offset {offset} and length {} must be multiples of 4", bytes.len()));
        }
        if offset.checked_add(bytes.len() as u64).is_none_or(|end| end > buffer.size_bytes()) {
            let length = bytes.len();
            return refuse(format!("{length} bytes at {offset} pass the end at {}", buffer.size_bytes()));
        }
        let mut at = offset;
        for (index, chunk) in bytes.chunks(UPLOAD_CHUNK_BYTES).enumerate() {
            if index > 0 {
                // Lets the driver free the staging memory of the previous chunk.
                let submitted = inner.queue.submit(std::iter::empty());
                inner.wait_for(&submitted, inner.submission_limit, "upload")?;
            }
            inner.scoped(buffer.label(), chunk.len() as u64, || {
                inner.queue.write_buffer(&buffer.inner.raw, at, chunk);
            })?;
            at += chunk.len() as u64;
        }
        buffer.mark_written();
        inner.check()
    }

    /// Destroys the device, as a driver reset does: every later call returns [`GpuError::DeviceLost`].
    pub fn force_loss(&self) -> Result<(), GpuError> {
        if !self.inner.allows_forced_loss {
            return Err(GpuError::ForcedLossNotAllowed);
        }
        self.inner.loss.mark("lost on purpose");
        self.inner.device.destroy();
        let _ = self.inner.poll(wgpu::PollType::Poll);
        Ok(())
    }
}

impl fmt::Debug for Gpu {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "Gpu(`{}`)", self.inner.report.name)
    }
}

impl Inner {
    /// Fails once the device is lost.
    pub(crate) fn check(&self) -> Result<(), GpuError> {
        if self.loss.lost.load(Ordering::Acquire) {
            let reason = self.loss.reason.get().cloned().unwrap_or_default();
            return Err(GpuError::DeviceLost { reason });
        }
        Ok(())
    }

    /// Format of targets; fails on a device that cannot draw.
    pub(crate) fn raster(&self) -> Result<wgpu::TextureFormat, GpuError> {
        let refuse = |reason: &String| GpuError::Validation {
            context: format!("adapter `{}`", self.report.name),
            message: reason.clone(),
        };
        self.target_format.as_ref().copied().map_err(refuse)
    }

    pub(crate) fn mark_lost(&self, reason: &str) {
        self.loss.mark(reason);
    }

    /// Runs `call` and converts an error of the driver into ours. `bytes` is what it allocates.
    pub(crate) fn scoped<T>(&self, context: &str, bytes: u64, call: impl FnOnce() -> T) -> Result<T, GpuError> {
        let memory = self.device.push_error_scope(wgpu::ErrorFilter::OutOfMemory);
        let internal = self.device.push_error_scope(wgpu::ErrorFilter::Internal);
        let validation = self.device.push_error_scope(wgpu::ErrorFilter::Validation);
        let result = call();
        // Scopes are a stack: the last one pushed is popped first.
        let validation = ready(validation.pop()).flatten();
        let internal = ready(internal.pop()).flatten();
        let memory = ready(memory.pop()).flatten();
        self.check()?;
        if memory.is_some() {
            return Err(GpuError::OutOfMemory { field: context.to_owned(), needed: bytes, free: 0 });
        }
        match validation.or(internal) {
            Some(error) => Err(GpuError::Validation { context: context.to_owned(), message: error.to_string() }),
            None => Ok(result),
        }
    }

    /// Polls the driver. Returns whether the work waited for is done.
    pub(crate) fn poll(&self, how: wgpu::PollType) -> Result<bool, GpuError> {
        // wgpu panics where the driver reports a loss during the wait; this is a loss like any other.
        match catch_unwind(AssertUnwindSafe(|| self.device.poll(how))) {
            Ok(Ok(status)) => {
                self.check()?;
                Ok(status.wait_finished())
            }
            Ok(Err(wgpu::PollError::Timeout)) => Ok(false),
            Ok(Err(error)) => {
                Err(GpuError::Validation { context: "waiting for the device".to_owned(), message: error.to_string() })
            }
            Err(_) => {
                self.loss.mark("the driver failed while it was waited for");
                self.check().map(|()| false)
            }
        }
    }

    /// Waits until a submission is done; a device that takes longer than `limit` counts as lost.
    pub(crate) fn wait_for(
        &self,
        submission: &wgpu::SubmissionIndex,
        limit: Duration,
        label: &str,
    ) -> Result<(), GpuError> {
        let how = wgpu::PollType::Wait { submission_index: Some(submission.clone()), timeout: Some(limit) };
        if self.poll(how)? {
            return Ok(());
        }
        let error = GpuError::Timeout { graph: label.to_owned(), limit_ms: limit.as_millis() as u64 };
        self.loss.mark(&error.to_string());
        Err(error)
    }

    /// Saves the driver's compiled pipelines, if it keeps any.
    pub(crate) fn save_pipelines(&self) {
        if let Some((path, cache)) = &self.pipeline_cache
            && let Some(data) = cache.get_data()
        {
            pipeline_cache::store(path, &data);
        }
    }
}

#[allow(unsafe_code, reason = "wgpu cannot check the contents of a pipeline cache")]
fn open_pipeline_cache(device: &wgpu::Device, path: PathBuf) -> (PathBuf, wgpu::PipelineCache) {
    let data = pipeline_cache::load(&path);
    let descriptor = wgpu::PipelineCacheDescriptor { label: Some("pipelines"), data: data.as_deref(), fallback: true };
    // SAFETY: the data comes from `get_data` of a device of the same adapter and driver version, which the file name
    // tells apart, and its checksum has been verified.
    let cache = unsafe { device.create_pipeline_cache(&descriptor) };
    (path, cache)
}

fn half_of_system_memory() -> u64 {
    let text = std::fs::read_to_string("/proc/meminfo").unwrap_or_default();
    let total_kib = text.lines().find_map(|line| {
        let rest = line.strip_prefix("MemTotal:")?;
        rest.trim().strip_suffix("kB")?.trim().parse::<u64>().ok()
    });
    total_kib.map_or(DEFAULT_BUDGET_BYTES, |kib| kib * 1024 / 2)
}
