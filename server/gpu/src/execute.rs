//! Running a graph: encoding, timing, waiting, reading bytes back.
//!
//! On GPUs a graph is one submission with a pair of timestamps around each pass. On CPU devices it is one submission a
//! pass, timed by the wall clock around submitting and waiting, since their timestamps are wrong ([`PassTiming`]).

use std::fmt;
use std::sync::Arc;
use std::sync::atomic::{AtomicU8, Ordering};
use std::time::{Duration, Instant};

use crate::device::{Gpu, Inner, PassTiming};
use crate::error::GpuError;
use crate::graph::{Bound, Graph, Pass, PassWork, ReadBack, Step, Ticket};
use crate::kernel::Pipeline;
use crate::staging::StagingBuffer;

/// Passes of one graph that have timestamps; the time of further ones counts as zero.
const TIMED_PASSES: usize = 1024;
const TIMESTAMP_BYTES: u64 = 8;

/// Time of all dispatches of one kernel in a graph.
#[derive(Debug, Clone, PartialEq)]
pub struct PassTime {
    /// Name of the kernel.
    pub name: String,
    /// Milliseconds.
    pub gpu_ms: f64,
    /// Dispatches.
    pub dispatches: u32,
}

/// Results of a finished graph.
#[derive(Debug, Clone)]
pub struct GraphReport {
    /// In order of first dispatch.
    pub passes: Vec<PassTime>,
    /// From submission to the end of waiting, milliseconds.
    pub wall_ms: f64,
    bytes: Vec<Option<Vec<u8>>>,
}

impl GraphReport {
    /// The bytes of a ticket, once.
    pub fn take(&mut self, ticket: Ticket) -> Result<Vec<u8>, GpuError> {
        self.bytes.get_mut(ticket.0).and_then(Option::take).ok_or_else(|| GpuError::Validation {
            context: "taking a read back".to_owned(),
            message: "the ticket is of another graph, or its bytes were taken already".to_owned(),
        })
    }

    /// Milliseconds of all passes.
    pub fn gpu_ms(&self) -> f64 {
        self.passes.iter().map(|pass| pass.gpu_ms).sum()
    }
}

/// A submitted graph. Dropping it lets the work finish without a report.
#[must_use = "a submission is waited for, or its times and bytes are lost"]
pub struct Submission {
    gpu: Gpu,
    label: String,
    index: wgpu::SubmissionIndex,
    started: Instant,
    passes: Vec<PassTime>,
    /// For each timed dispatch, in order, the place in `passes`.
    timed: Vec<usize>,
    timestamps: Option<Mapping>,
    read_backs: Vec<(ReadBack, Mapping)>,
}

impl fmt::Debug for Submission {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "Submission(`{}`)", self.label)
    }
}

const MAPPING_PENDING: u8 = 0;
const MAPPING_DONE: u8 = 1;
const MAPPING_FAILED: u8 = 2;

/// A staging buffer being mapped.
struct Mapping {
    buffer: StagingBuffer,
    bytes: u64,
    state: Arc<AtomicU8>,
}

impl Mapping {
    fn start(buffer: StagingBuffer, bytes: u64) -> Self {
        let state = Arc::new(AtomicU8::new(MAPPING_PENDING));
        let shared = Arc::clone(&state);
        buffer.raw.slice(..bytes).map_async(wgpu::MapMode::Read, move |result| {
            let outcome = if result.is_ok() { MAPPING_DONE } else { MAPPING_FAILED };
            shared.store(outcome, Ordering::Release);
        });
        Mapping { buffer, bytes, state }
    }

    /// Passes the mapped bytes to `read` and returns the buffer to the ring.
    fn finish<T>(self, gpu: &Inner, read: impl FnOnce(&[u8]) -> T) -> Result<T, GpuError> {
        let failed = |message: String| GpuError::Validation { context: "read back".to_owned(), message };
        if self.state.load(Ordering::Acquire) == MAPPING_PENDING {
            // The callback runs within a poll after the work is done.
            gpu.poll(wgpu::PollType::Wait { submission_index: None, timeout: Some(gpu.submission_limit) })?;
        }
        if self.state.load(Ordering::Acquire) != MAPPING_DONE {
            gpu.check()?;
            return Err(failed("the buffer could not be mapped".to_owned()));
        }
        let view = self.buffer.raw.slice(..self.bytes).get_mapped_range().map_err(|error| failed(error.to_string()))?;
        let result = read(&view);
        drop(view);
        self.buffer.raw.unmap();
        gpu.staging.give_back(self.buffer);
        Ok(result)
    }
}

impl Submission {
    /// Waits until the graph has run. A device that exceeds the submission limit counts as lost.
    pub fn wait(self) -> Result<GraphReport, GpuError> {
        let limit = self.gpu.inner.submission_limit;
        self.gpu.inner.wait_for(&self.index, limit, &self.label)?;
        self.collect()
    }

    /// Waits for at most `timeout` and returns the submission if it is still running. A device that exceeds the
    /// submission limit counts as lost.
    pub fn try_wait(self, timeout: Duration) -> Result<Result<GraphReport, Submission>, GpuError> {
        let how = wgpu::PollType::Wait { submission_index: Some(self.index.clone()), timeout: Some(timeout) };
        if self.gpu.inner.poll(how)? {
            return self.collect().map(Ok);
        }
        let limit = self.gpu.inner.submission_limit;
        if self.started.elapsed() > limit {
            let error = GpuError::Timeout { graph: self.label.clone(), limit_ms: limit.as_millis() as u64 };
            self.gpu.inner.mark_lost(&error.to_string());
            return Err(error);
        }
        Ok(Err(self))
    }

    fn collect(mut self) -> Result<GraphReport, GpuError> {
        let inner = &self.gpu.inner;
        if let Some(mapping) = self.timestamps.take() {
            let period_ns = f64::from(inner.queue.get_timestamp_period());
            let ticks: Vec<u64> = mapping.finish(inner, |bytes| {
                let words = bytes.chunks_exact(TIMESTAMP_BYTES as usize);
                words.map(|word| u64::from_le_bytes(word.try_into().unwrap_or_default())).collect()
            })?;
            for (pair, &pass) in ticks.chunks_exact(2).zip(&self.timed) {
                // On some drivers the clocks of two engines differ slightly.
                self.passes[pass].gpu_ms += pair[1].saturating_sub(pair[0]) as f64 * period_ns * 1e-6;
            }
        }
        let mut bytes = Vec::with_capacity(self.read_backs.len());
        for (read_back, mapping) in self.read_backs {
            let start = (read_back.range.start - read_back.aligned.start) as usize;
            let length = (read_back.range.end - read_back.range.start) as usize;
            bytes.push(Some(mapping.finish(inner, |mapped| mapped[start..start + length].to_vec())?));
        }
        let wall_ms = self.started.elapsed().as_secs_f64() * 1e3;
        Ok(GraphReport { passes: self.passes, wall_ms, bytes })
    }
}

impl Graph {
    /// Runs all passes. On CPU devices this waits for each pass, to time it; on others it returns at once.
    pub fn submit(self) -> Result<Submission, GpuError> {
        let gpu = self.gpu.clone();
        let inner = &*gpu.inner;
        inner.check()?;
        let started = Instant::now();
        // Held until everything is queued: uniform data and the passes that read it must not be separated by another
        // graph's.
        let mut uniforms = inner.uniforms.lock();
        let context = format!("graph `{}`", self.label);
        let mut recorded = None;
        let scoped = inner.scoped(&context, self.uniforms.len() as u64, || {
            recorded = Some(record(inner, &self, &mut uniforms));
        });
        // An error of the recording is the cause of those in the scope.
        let Recorded { index, passes, timed, timestamps, staging } = match recorded {
            Some(Ok(recorded)) => scoped.map(|()| recorded)?,
            Some(Err(error)) => return Err(error),
            None => return Err(GpuError::Validation { context, message: "nothing was recorded".to_owned() }),
        };
        drop(uniforms);
        for buffer in &self.written {
            buffer.mark_written();
        }
        for target in &self.drawn {
            target.mark_written();
        }
        let timestamps = timestamps.map(|buffer| Mapping::start(buffer, timed.len() as u64 * 2 * TIMESTAMP_BYTES));
        let read_backs = self.read_backs.into_iter().zip(staging).map(|(read_back, buffer)| {
            let bytes = read_back.aligned.end - read_back.aligned.start;
            (read_back, Mapping::start(buffer, bytes))
        });
        let read_backs = read_backs.collect();
        Ok(Submission { gpu: gpu.clone(), label: self.label, index, started, passes, timed, timestamps, read_backs })
    }
}

struct Recorded {
    index: wgpu::SubmissionIndex,
    passes: Vec<PassTime>,
    timed: Vec<usize>,
    timestamps: Option<StagingBuffer>,
    staging: Vec<StagingBuffer>,
}

fn record(inner: &Inner, graph: &Graph, uniforms: &mut Option<wgpu::Buffer>) -> Result<Recorded, GpuError> {
    upload_uniforms(inner, &graph.uniforms, uniforms);
    let uniforms = uniforms.as_ref();
    let staging = graph.read_backs.iter().map(|read_back| {
        inner.staging.take(&inner.device, &inner.ledger, read_back.aligned.end - read_back.aligned.start)
    });
    let staging: Vec<StagingBuffer> = staging.collect::<Result<_, _>>()?;

    let by_wall_clock = inner.timing == PassTiming::WallClock;
    let dispatch_count = graph.steps.iter().filter(|step| matches!(step, Step::Pass(_))).count();
    let queries = (inner.has_timestamps && dispatch_count > 0).then(|| {
        let count = dispatch_count.min(TIMED_PASSES) as u32 * 2;
        inner.device.create_query_set(&wgpu::QuerySetDescriptor {
            label: Some("pass times"),
            ty: wgpu::QueryType::Timestamp,
            count,
        })
    });

    let mut passes: Vec<PassTime> = Vec::new();
    let mut timed = Vec::new();
    let mut encoder = new_encoder(inner, &graph.label);
    for step in &graph.steps {
        match step {
            Step::Clear(buffer, bytes) => encoder.clear_buffer(&buffer.inner.raw, 0, Some(*bytes)),
            Step::ReadBack(index) => {
                let read_back = &graph.read_backs[*index];
                let length = read_back.aligned.end - read_back.aligned.start;
                let from = &read_back.buffer.inner.raw;
                encoder.copy_buffer_to_buffer(from, read_back.aligned.start, &staging[*index].raw, 0, length);
            }
            Step::Pass(pass) => {
                let place = pass_time(&mut passes, pass.kernel.name());
                passes[place].dispatches += 1;
                let timestamps = queries.as_ref().filter(|_| timed.len() < TIMED_PASSES).map(|query_set| {
                    let first = timed.len() as u32 * 2;
                    timed.push(place);
                    (query_set, first)
                });
                let encode =
                    |encoder: &mut wgpu::CommandEncoder| encode_pass(inner, encoder, pass, uniforms, timestamps);
                if inner.checks_passes {
                    // An invalid pass is reported when its encoder finishes, so each gets an encoder of its own.
                    let before = std::mem::replace(&mut encoder, new_encoder(inner, &graph.label));
                    let context = format!("pass `{}`", pass.kernel.name());
                    let commands = inner.scoped(&context, 0, || {
                        encode(&mut encoder);
                        std::mem::replace(&mut encoder, new_encoder(inner, &graph.label)).finish()
                    })?;
                    let submitted_at = Instant::now();
                    let index = inner.scoped(&context, 0, || inner.queue.submit([before.finish(), commands]))?;
                    if by_wall_clock {
                        inner.wait_for(&index, inner.submission_limit, &graph.label)?;
                        passes[place].gpu_ms += submitted_at.elapsed().as_secs_f64() * 1e3;
                    }
                } else {
                    encode(&mut encoder);
                    if by_wall_clock {
                        let commands = std::mem::replace(&mut encoder, new_encoder(inner, &graph.label)).finish();
                        let submitted_at = Instant::now();
                        let index = inner.queue.submit([commands]);
                        inner.wait_for(&index, inner.submission_limit, &graph.label)?;
                        passes[place].gpu_ms += submitted_at.elapsed().as_secs_f64() * 1e3;
                    }
                }
            }
        }
    }
    let timestamps = match &queries {
        Some(queries) => Some(resolve(inner, &mut encoder, queries, timed.len() as u32 * 2)?),
        None => None,
    };
    let index = inner.queue.submit([encoder.finish()]);
    Ok(Recorded { index, passes, timed, timestamps, staging })
}

fn new_encoder(inner: &Inner, label: &str) -> wgpu::CommandEncoder {
    inner.device.create_command_encoder(&wgpu::CommandEncoderDescriptor { label: Some(label) })
}

fn pass_time(passes: &mut Vec<PassTime>, name: &str) -> usize {
    if let Some(place) = passes.iter().position(|pass| pass.name == name) {
        return place;
    }
    passes.push(PassTime { name: name.to_owned(), gpu_ms: 0.0, dispatches: 0 });
    passes.len() - 1
}

/// One buffer serves all graphs: writes and submissions take effect in the order in which they are queued.
fn upload_uniforms(inner: &Inner, data: &[u8], uniforms: &mut Option<wgpu::Buffer>) {
    if data.is_empty() {
        return;
    }
    let size = data.len() as u64;
    if uniforms.as_ref().is_none_or(|buffer| buffer.size() < size) {
        *uniforms = Some(inner.device.create_buffer(&wgpu::BufferDescriptor {
            label: Some("uniforms"),
            size: size.next_power_of_two().max(4096),
            usage: wgpu::BufferUsages::UNIFORM | wgpu::BufferUsages::COPY_DST,
            mapped_at_creation: false,
        }));
    }
    if let Some(buffer) = uniforms {
        inner.queue.write_buffer(buffer, 0, data);
    }
}

fn encode_pass(
    inner: &Inner,
    encoder: &mut wgpu::CommandEncoder,
    pass: &Pass,
    uniforms: Option<&wgpu::Buffer>,
    timestamps: Option<(&wgpu::QuerySet, u32)>,
) {
    let label = Some(pass.kernel.name());
    let bind_groups = bind_groups(inner, pass, uniforms);
    match (&pass.kernel.inner.pipeline, &pass.work) {
        (Pipeline::Compute(pipeline), PassWork::Workgroups(_) | PassWork::Indirect(..)) => {
            let timestamp_writes = timestamps.map(|(query_set, first)| wgpu::ComputePassTimestampWrites {
                query_set,
                beginning_of_pass_write_index: Some(first),
                end_of_pass_write_index: Some(first + 1),
            });
            let mut commands = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor { label, timestamp_writes });
            commands.set_pipeline(pipeline);
            for (group, bind_group) in &bind_groups {
                commands.set_bind_group(*group, bind_group, &[]);
            }
            match &pass.work {
                PassWork::Workgroups([x, y, z]) => commands.dispatch_workgroups(*x, *y, *z),
                PassWork::Indirect(buffer, offset) => {
                    commands.dispatch_workgroups_indirect(&buffer.inner.raw, *offset);
                }
                PassWork::Draw(..) => {}
            }
        }
        (Pipeline::Raster(pipeline), PassWork::Draw(vertex_count, targets)) => {
            let timestamp_writes = timestamps.map(|(query_set, first)| wgpu::RenderPassTimestampWrites {
                query_set,
                beginning_of_pass_write_index: Some(first),
                end_of_pass_write_index: Some(first + 1),
            });
            let attachments = targets.iter().map(|target| {
                Some(wgpu::RenderPassColorAttachment {
                    view: &target.inner.view,
                    depth_slice: None,
                    resolve_target: None,
                    ops: wgpu::Operations {
                        load: wgpu::LoadOp::Clear(wgpu::Color::TRANSPARENT),
                        store: wgpu::StoreOp::Store,
                    },
                })
            });
            let attachments: Vec<_> = attachments.collect();
            let mut commands = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
                label,
                color_attachments: &attachments,
                timestamp_writes,
                ..wgpu::RenderPassDescriptor::default()
            });
            commands.set_pipeline(pipeline);
            for (group, bind_group) in &bind_groups {
                commands.set_bind_group(*group, bind_group, &[]);
            }
            commands.draw(0..*vertex_count, 0..1);
        }
        // Refused when the pass is recorded.
        (Pipeline::Compute(_), PassWork::Draw(..)) | (Pipeline::Raster(_), _) => {}
    }
}

/// A pass' bind groups with their indices.
fn bind_groups(inner: &Inner, pass: &Pass, uniforms: Option<&wgpu::Buffer>) -> Vec<(u32, wgpu::BindGroup)> {
    let kernel = &*pass.kernel.inner;
    let mut groups = Vec::new();
    for (group, layout) in kernel.layouts.iter().enumerate() {
        let Some(layout) = layout else { continue };
        let bindings = kernel.reflection.bindings.iter().zip(&pass.bound);
        let entries: Vec<wgpu::BindGroupEntry<'_>> = bindings
            .filter(|(binding, _)| binding.group as usize == group)
            .filter_map(|(binding, bound)| {
                let resource = match bound {
                    Bound::Storage(buffer) => buffer.inner.raw.as_entire_binding(),
                    Bound::Texture(target) => wgpu::BindingResource::TextureView(&target.inner.view),
                    Bound::Uniform { offset, size_bytes } => wgpu::BindingResource::Buffer(wgpu::BufferBinding {
                        buffer: uniforms?,
                        offset: *offset,
                        size: std::num::NonZeroU64::new(*size_bytes),
                    }),
                };
                Some(wgpu::BindGroupEntry { binding: binding.binding, resource })
            })
            .collect();
        let bind_group = inner.device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some(pass.kernel.name()),
            layout,
            entries: &entries,
        });
        groups.push((group as u32, bind_group));
    }
    groups
}

fn resolve(
    inner: &Inner,
    encoder: &mut wgpu::CommandEncoder,
    queries: &wgpu::QuerySet,
    count: u32,
) -> Result<StagingBuffer, GpuError> {
    let bytes = u64::from(count) * TIMESTAMP_BYTES;
    let resolved = inner.device.create_buffer(&wgpu::BufferDescriptor {
        label: Some("pass times"),
        size: bytes,
        usage: wgpu::BufferUsages::QUERY_RESOLVE | wgpu::BufferUsages::COPY_SRC,
        mapped_at_creation: false,
    });
    encoder.resolve_query_set(queries, 0..count, &resolved, 0);
    let staging = inner.staging.take(&inner.device, &inner.ledger, bytes)?;
    encoder.copy_buffer_to_buffer(&resolved, 0, &staging.raw, 0, bytes);
    Ok(staging)
}
