//! Targets of raster kernels: images of four floats a pixel with additive blending.

use std::fmt;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use crate::device::Gpu;
use crate::error::GpuError;
use crate::memory::{Admission, MemoryKind, next_id};

/// An image of four floats a pixel: drawn by a raster kernel, then read by others as `texture_2d<f32>`. Clones share
/// it.
#[derive(Clone)]
pub struct Target {
    pub(crate) inner: Arc<TargetInner>,
}

pub(crate) struct TargetInner {
    pub(crate) view: wgpu::TextureView,
    pub(crate) label: String,
    pub(crate) size: [u32; 2],
    /// Distinguishes targets and buffers in a graph.
    pub(crate) id: u64,
    pub(crate) device_id: u64,
    written: AtomicBool,
    /// Freed after `view`, fields drop in order.
    _admission: Admission,
}

impl Target {
    /// Label given at creation.
    pub fn label(&self) -> &str {
        &self.inner.label
    }

    /// Pixels.
    pub fn size(&self) -> [u32; 2] {
        self.inner.size
    }

    pub(crate) fn is_written(&self) -> bool {
        self.inner.written.load(Ordering::Acquire)
    }

    pub(crate) fn mark_written(&self) {
        self.inner.written.store(true, Ordering::Release);
    }
}

impl fmt::Debug for Target {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [width, height] = self.inner.size;
        write!(f, "Target(`{}`, {width}x{height})", self.inner.label)
    }
}

impl Gpu {
    /// Whether raster kernels run on this device; the error names what it lacks.
    pub fn can_draw(&self) -> Result<(), GpuError> {
        self.inner.raster().map(|_| ())
    }

    /// Whether targets hold 32-bit floats; 16-bit ones otherwise.
    pub fn draws_full_floats(&self) -> bool {
        self.inner.target_format == Ok(wgpu::TextureFormat::Rgba32Float)
    }

    /// Allocates a target. Fails before the driver is called where the budget is exceeded or the device cannot draw.
    pub fn target(&self, label: &str, kind: MemoryKind, size: [u32; 2]) -> Result<Target, GpuError> {
        let inner = &self.inner;
        inner.check()?;
        let format = inner.raster()?;
        let limit = inner.device.limits().max_texture_dimension_2d;
        if let Some(&side) = size.iter().find(|&&side| side == 0 || side > limit) {
            let message = format!("a side of {side} pixels, this device draws 1 to {limit}");
            return Err(GpuError::Validation { context: format!("target `{label}`"), message });
        }
        let pixel_bytes = if format == wgpu::TextureFormat::Rgba32Float { 16 } else { 8 };
        let bytes = u64::from(size[0]) * u64::from(size[1]) * pixel_bytes;
        let admission = inner.ledger.admit(label, kind, bytes)?;
        let view = inner.scoped(label, bytes, || {
            let texture = inner.device.create_texture(&wgpu::TextureDescriptor {
                label: Some(label),
                size: wgpu::Extent3d { width: size[0], height: size[1], depth_or_array_layers: 1 },
                mip_level_count: 1,
                sample_count: 1,
                dimension: wgpu::TextureDimension::D2,
                format,
                usage: wgpu::TextureUsages::RENDER_ATTACHMENT | wgpu::TextureUsages::TEXTURE_BINDING,
                view_formats: &[],
            });
            texture.create_view(&wgpu::TextureViewDescriptor::default())
        })?;
        Ok(Target {
            inner: Arc::new(TargetInner {
                view,
                label: label.to_owned(),
                size,
                id: next_id(),
                device_id: inner.id,
                written: AtomicBool::new(false),
                _admission: admission,
            }),
        })
    }
}
