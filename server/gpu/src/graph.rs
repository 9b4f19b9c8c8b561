//! The frame graph: passes in order, each binding buffers by the names its kernel gives them.
//!
//! Mistakes are reported when the pass is recorded, with its name: a missing or surplus binding, the wrong access, a
//! buffer that is too small, of another device, bound twice where one use writes, or read before anything was written
//! to it.

use std::collections::HashSet;
use std::fmt;
use std::ops::Range;

use surfelcast_shaders::Access;

use crate::device::Gpu;
use crate::error::GpuError;
use crate::kernel::Kernel;
use crate::memory::Buffer;
use crate::target::Target;

/// Uniform data of one graph, bytes; a frame needs a few hundred.
const UNIFORM_BYTES_LIMIT: usize = 4 << 20;

/// Passes in the order in which they run. Created by [`Gpu::graph`].
#[derive(Debug)]
pub struct Graph {
    pub(crate) gpu: Gpu,
    pub(crate) label: String,
    pub(crate) steps: Vec<Step>,
    /// Uniform data of all passes, each at the device's alignment.
    pub(crate) uniforms: Vec<u8>,
    /// Buffers that some step of this graph writes.
    pub(crate) written: Vec<Buffer>,
    /// Targets that some step of this graph draws.
    pub(crate) drawn: Vec<Target>,
    written_ids: HashSet<u64>,
    pub(crate) read_backs: Vec<ReadBack>,
}

pub(crate) enum Step {
    /// This many bytes from the start.
    Clear(Buffer, u64),
    Pass(Pass),
    /// Index into the read backs. The bytes are copied at this point, before later passes change them.
    ReadBack(usize),
}

impl fmt::Debug for Step {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Step::Clear(buffer, _) => write!(f, "clear {}", buffer.label()),
            Step::Pass(pass) => write!(f, "pass {}", pass.kernel.name()),
            Step::ReadBack(index) => write!(f, "read back {index}"),
        }
    }
}

pub(crate) struct Pass {
    pub(crate) kernel: Kernel,
    /// Parallel to the kernel's bindings.
    pub(crate) bound: Vec<Bound>,
    pub(crate) work: PassWork,
}

pub(crate) enum Bound {
    Storage(Buffer),
    Uniform { offset: u64, size_bytes: u64 },
    Texture(Target),
}

/// What a pass does with its kernel.
pub(crate) enum PassWork {
    Workgroups([u32; 3]),
    /// Workgroups from a buffer at an offset.
    Indirect(Buffer, u64),
    /// Number of vertices, drawn into targets that are cleared first.
    Draw(u32, Vec<Target>),
}

#[derive(Debug)]
pub(crate) struct ReadBack {
    pub(crate) buffer: Buffer,
    /// Rounded outwards to multiples of four.
    pub(crate) aligned: Range<u64>,
    /// As requested.
    pub(crate) range: Range<u64>,
}

/// Names bytes that are returned with the report of a graph.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Ticket(pub(crate) usize);

impl Gpu {
    /// Starts an empty frame graph.
    pub fn graph(&self, label: &str) -> Graph {
        Graph {
            gpu: self.clone(),
            label: label.to_owned(),
            steps: Vec::new(),
            uniforms: Vec::new(),
            written: Vec::new(),
            drawn: Vec::new(),
            written_ids: HashSet::new(),
            read_backs: Vec::new(),
        }
    }
}

impl Graph {
    /// Starts a pass; it is part of the graph once dispatched.
    pub fn pass(&mut self, kernel: &Kernel) -> PassBuilder<'_> {
        let bound = kernel.reflection().bindings.iter().map(|_| None).collect();
        PassBuilder { graph: self, kernel: kernel.clone(), bound, problem: None }
    }

    /// Fills the buffer with zeros.
    pub fn clear(&mut self, buffer: &Buffer) -> Result<(), GpuError> {
        self.clear_first(buffer, buffer.size_bytes())
    }

    /// Fills the first `bytes` of the buffer with zeros: a multiple of four, at most its size.
    pub fn clear_first(&mut self, buffer: &Buffer, bytes: u64) -> Result<(), GpuError> {
        self.owns(buffer, "clear")?;
        if bytes > buffer.size_bytes() || !bytes.is_multiple_of(4) {
            let message = format!("{bytes} bytes are no multiple of four or pass the end at {}", buffer.size_bytes());
            return Err(GpuError::Validation { context: format!("clear of `{}`", buffer.label()), message });
        }
        self.mark_written(buffer);
        self.steps.push(Step::Clear(buffer.clone(), bytes));
        Ok(())
    }

    /// Copies bytes of the buffer to the host, as they are after the passes so far. They are returned with the report.
    pub fn read_back(&mut self, buffer: &Buffer, range: Range<u64>) -> Result<Ticket, GpuError> {
        self.owns(buffer, "read back")?;
        let refuse = |message: String| {
            Err(GpuError::Validation { context: format!("read back of `{}`", buffer.label()), message })
        };
        if range.start >= range.end || range.end > buffer.size_bytes() {
            return refuse(format!("bytes {range:?} are empty or pass the end at {}", buffer.size_bytes()));
        }
        if !self.is_written(buffer) {
            return refuse("nothing was ever written to it".to_owned());
        }
        let aligned = range.start / 4 * 4..range.end.next_multiple_of(4);
        self.read_backs.push(ReadBack { buffer: buffer.clone(), aligned, range });
        let index = self.read_backs.len() - 1;
        self.steps.push(Step::ReadBack(index));
        Ok(Ticket(index))
    }

    fn owns(&self, buffer: &Buffer, what: &str) -> Result<(), GpuError> {
        if buffer.inner.device_id == self.gpu.inner.id {
            return Ok(());
        }
        let message = "the buffer belongs to another device".to_owned();
        Err(GpuError::Validation { context: format!("{what} of `{}`", buffer.label()), message })
    }

    fn is_written(&self, buffer: &Buffer) -> bool {
        buffer.is_written() || self.written_ids.contains(&buffer.inner.id)
    }

    fn mark_written(&mut self, buffer: &Buffer) {
        if self.written_ids.insert(buffer.inner.id) {
            self.written.push(buffer.clone());
        }
    }
}

/// A pass being recorded. The first mistake is kept and returned by the dispatch.
#[derive(Debug)]
#[must_use = "a pass does nothing until it is dispatched"]
pub struct PassBuilder<'g> {
    graph: &'g mut Graph,
    kernel: Kernel,
    bound: Vec<Option<Bound>>,
    problem: Option<GpuError>,
}

impl fmt::Debug for Bound {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Bound::Storage(buffer) => buffer.fmt(f),
            Bound::Uniform { offset, size_bytes } => write!(f, "uniform {offset}+{size_bytes}"),
            Bound::Texture(target) => target.fmt(f),
        }
    }
}

impl PassBuilder<'_> {
    /// Binds a buffer the kernel only reads.
    pub fn read(self, name: &str, buffer: &Buffer) -> Self {
        self.storage(name, buffer, Access::StorageRead)
    }

    /// Binds a buffer the kernel writes, or reads and writes.
    pub fn read_write(self, name: &str, buffer: &Buffer) -> Self {
        self.storage(name, buffer, Access::StorageReadWrite)
    }

    /// Binds the buffer with the access that the kernel declares.
    pub fn bind(self, name: &str, buffer: &Buffer) -> Self {
        let bindings = &self.kernel.reflection().bindings;
        match bindings.iter().find(|binding| binding.name == name).map(|binding| binding.access) {
            Some(Access::StorageReadWrite) => self.read_write(name, buffer),
            _ => self.read(name, buffer),
        }
    }

    /// Binds the buffer with the access that the kernel declares, if this variant of it has such a binding.
    pub fn bind_if_bound(self, name: &str, buffer: &Buffer) -> Self {
        if self.kernel.binds(name) { self.bind(name, buffer) } else { self }
    }

    /// Binds a target that was drawn before.
    pub fn texture(mut self, name: &str, target: &Target) -> Self {
        let Some(index) = self.slot(name, Access::Texture) else { return self };
        if target.inner.device_id != self.graph.gpu.inner.id {
            return self.fail(name, format!("`{}` belongs to another device", target.label()));
        }
        if !target.is_written() && !self.graph.written_ids.contains(&target.inner.id) {
            return self.fail(name, format!("`{}` is read, but nothing was ever drawn into it", target.label()));
        }
        self.bound[index] = Some(Bound::Texture(target.clone()));
        self
    }

    /// Binds constants of this dispatch: the bytes of the structure the kernel declares.
    pub fn uniform(mut self, name: &str, bytes: &[u8]) -> Self {
        let Some(index) = self.slot(name, Access::Uniform) else { return self };
        let needed = self.kernel.reflection().bindings[index].min_size as usize;
        if bytes.len() != needed {
            let given = bytes.len();
            return self.fail(name, format!("{given} bytes are given, the kernel's structure has {needed}"));
        }
        let alignment = self.graph.gpu.limits().uniform_alignment.max(16) as usize;
        let offset = self.graph.uniforms.len().next_multiple_of(alignment);
        let end = offset + bytes.len().next_multiple_of(16);
        if end > UNIFORM_BYTES_LIMIT {
            return self.fail(name, format!("a graph carries at most {UNIFORM_BYTES_LIMIT} bytes of uniform data"));
        }
        self.graph.uniforms.resize(end, 0);
        self.graph.uniforms[offset..offset + bytes.len()].copy_from_slice(bytes);
        let size_bytes = (end - offset) as u64;
        self.bound[index] = Some(Bound::Uniform { offset: offset as u64, size_bytes });
        self
    }

    /// Adds the pass with a fixed number of workgroups in x, y, z. Zero of any is allowed and does nothing.
    pub fn dispatch(self, workgroups: [u32; 3]) -> Result<(), GpuError> {
        let limit = self.graph.gpu.limits().workgroups_per_dimension;
        if let Some(&count) = workgroups.iter().find(|&&count| count > limit) {
            let message = format!("{count} workgroups in one dimension, this device allows {limit}");
            return Err(GpuError::Validation { context: format!("pass `{}`", self.kernel.name()), message });
        }
        self.finish(PassWork::Workgroups(workgroups))
    }

    /// Adds the pass with the number of workgroups that `buffer` holds at `offset`: three `u32`. Made by
    /// [`Gpu::indirect_buffer`].
    pub fn dispatch_indirect(self, buffer: &Buffer, offset: u64) -> Result<(), GpuError> {
        let refuse = |message: &str| {
            let context = format!("pass `{}`, sizes from `{}`", self.kernel.name(), buffer.label());
            Err(GpuError::Validation { context, message: message.to_owned() })
        };
        if !buffer.inner.indirect {
            return refuse("the buffer was not made by `indirect_buffer`");
        }
        if !offset.is_multiple_of(4) || offset.checked_add(12).is_none_or(|end| end > buffer.size_bytes()) {
            return refuse("the offset is no multiple of 4, or passes the end");
        }
        if !self.graph.is_written(buffer) {
            return refuse("nothing was ever written to it");
        }
        let bindings = self.kernel.reflection().bindings.iter().zip(&self.bound);
        let mut aliases = bindings.filter(|(binding, bound)| {
            binding.access == Access::StorageReadWrite
                && matches!(bound, Some(Bound::Storage(other)) if other.same_as(buffer))
        });
        if aliases.next().is_some() {
            return refuse("the pass itself writes it");
        }
        self.graph.owns(buffer, "dispatch")?;
        self.finish(PassWork::Indirect(buffer.clone(), offset))
    }

    /// Adds the pass of a raster kernel: clears the targets, in the order of the kernel's outputs, and draws triangles
    /// of `vertex_count` vertices into them.
    pub fn draw(self, vertex_count: u32, targets: &[&Target]) -> Result<(), GpuError> {
        let wanted = self.kernel.reflection().target_count as usize;
        let problem = if wanted != targets.len() {
            Some(format!("{} targets are given, the kernel draws into {wanted}", targets.len()))
        } else if targets.iter().any(|target| target.inner.device_id != self.graph.gpu.inner.id) {
            Some("a target belongs to another device".to_owned())
        } else if targets.iter().any(|target| target.size() != targets[0].size()) {
            Some("its targets differ in size".to_owned())
        } else {
            let is_read = |target: &&Target| {
                let bound = self.bound.iter().flatten();
                bound.into_iter().any(|bound| matches!(bound, Bound::Texture(read) if read.inner.id == target.inner.id))
            };
            let is_repeated = |(index, target): (usize, &&Target)| {
                targets[..index].iter().any(|other| other.inner.id == target.inner.id)
            };
            let is_wrong = targets.iter().any(is_read) || targets.iter().enumerate().any(is_repeated);
            is_wrong.then(|| "a target is drawn into and read, or drawn into twice".to_owned())
        };
        if let Some(message) = problem {
            return Err(GpuError::Validation { context: format!("pass `{}`", self.kernel.name()), message });
        }
        self.finish(PassWork::Draw(vertex_count, targets.iter().map(|&target| target.clone()).collect()))
    }

    fn finish(mut self, work: PassWork) -> Result<(), GpuError> {
        if let Some(problem) = self.problem.take() {
            return Err(problem);
        }
        if self.kernel.inner.device_id != self.graph.gpu.inner.id {
            let message = "the kernel belongs to another device".to_owned();
            return Err(GpuError::Validation { context: format!("pass `{}`", self.kernel.name()), message });
        }
        if (self.kernel.reflection().target_count > 0) != matches!(work, PassWork::Draw(..)) {
            let message =
                "a raster kernel draws and a compute kernel is dispatched, not the other way round".to_owned();
            return Err(GpuError::Validation { context: format!("pass `{}`", self.kernel.name()), message });
        }
        let bindings = &self.kernel.reflection().bindings;
        if let Some(index) = self.bound.iter().position(Option::is_none) {
            let name = bindings[index].name.clone();
            return Err(self.binding_error(&name, "the kernel binds it, the pass does not".to_owned()));
        }
        let bound: Vec<Bound> = std::mem::take(&mut self.bound).into_iter().flatten().collect();
        for (binding, bound) in bindings.iter().zip(&bound) {
            if let (Access::StorageReadWrite, Bound::Storage(buffer)) = (binding.access, bound) {
                self.graph.mark_written(buffer);
            }
        }
        if let PassWork::Draw(_, targets) = &work {
            for target in targets.iter().filter(|target| self.graph.written_ids.insert(target.inner.id)) {
                self.graph.drawn.push(target.clone());
            }
        }
        self.graph.steps.push(Step::Pass(Pass { kernel: self.kernel, bound, work }));
        Ok(())
    }

    fn storage(mut self, name: &str, buffer: &Buffer, access: Access) -> Self {
        let Some(index) = self.slot(name, access) else { return self };
        let least = u64::from(self.kernel.reflection().bindings[index].min_size);
        if buffer.size_bytes() < least {
            let given = buffer.size_bytes();
            return self.fail(name, format!("`{}` has {given} bytes, the kernel needs {least}", buffer.label()));
        }
        if buffer.inner.device_id != self.graph.gpu.inner.id {
            return self.fail(name, format!("`{}` belongs to another device", buffer.label()));
        }
        if access == Access::StorageRead && !self.graph.is_written(buffer) {
            return self.fail(name, format!("`{}` is read, but nothing was ever written to it", buffer.label()));
        }
        let bindings = self.kernel.reflection().bindings.iter().zip(&self.bound);
        let alias = bindings.filter(|(_, bound)| matches!(bound, Some(Bound::Storage(other)) if other.same_as(buffer)));
        let alias = alias
            .filter(|(binding, _)| access == Access::StorageReadWrite || binding.access == Access::StorageReadWrite)
            .map(|(binding, _)| binding.name.clone())
            .next();
        if let Some(other) = alias {
            return self.fail(name, format!("`{}` is bound as `{other}` too, and one of them writes", buffer.label()));
        }
        self.bound[index] = Some(Bound::Storage(buffer.clone()));
        self
    }

    /// Index of a binding, if the kernel has it with this access and it is not bound yet.
    fn slot(&mut self, name: &str, access: Access) -> Option<usize> {
        let bindings = &self.kernel.reflection().bindings;
        let Some(index) = bindings.iter().position(|binding| binding.name == name) else {
            let names: Vec<&str> = bindings.iter().map(|binding| binding.name.as_str()).collect();
            let problem = format!("the kernel has no such binding; it has: {}", names.join(", "));
            self.note(name, problem);
            return None;
        };
        let declared = bindings[index].access;
        if declared != access {
            let right = match declared {
                Access::Uniform => "bind it with `uniform`",
                Access::StorageRead => "the kernel only reads it: bind it with `read`",
                Access::StorageReadWrite => "the kernel writes it: bind it with `read_write`",
                Access::Texture => "the kernel reads texels: bind it with `texture`",
            };
            self.note(name, right.to_owned());
            return None;
        }
        if self.bound[index].is_some() {
            self.note(name, "it is bound twice".to_owned());
            return None;
        }
        Some(index)
    }

    fn fail(mut self, name: &str, problem: String) -> Self {
        self.note(name, problem);
        self
    }

    fn note(&mut self, name: &str, problem: String) {
        if self.problem.is_none() {
            self.problem = Some(self.binding_error(name, problem));
        }
    }

    fn binding_error(&self, name: &str, problem: String) -> GpuError {
        GpuError::Binding { pass: self.kernel.name().to_owned(), name: name.to_owned(), problem }
    }
}
