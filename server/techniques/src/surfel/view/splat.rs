//! Surfels drawn onto the image instead of gathered by its pixels, as in Noack 2022 (5.9); and both ways, to compare
//! them.

use surfelcast_gpu::{Buffer, Gpu, GpuError, Graph, Kernel, MemoryKind, PassBuilder, PassTime, Target};
use surfelcast_passes::frame::FrameView;
use surfelcast_passes::lights::LightBuffers;
use surfelcast_passes::upload::SceneBuffers;
use surfelcast_passes::visibility::{self, Visibility};
use surfelcast_passes::workgroups_of;
use surfelcast_shaders::Features;
use surfelcast_shaders::layout::bytemuck;
use surfelcast_shaders::records::SurfelUniforms;

use crate::surfel::cache::{CacheCamera, SurfelCache};
use crate::surfel::settings::Apply;

/// Kernels read the sums of drawn surfels instead of gathering.
pub(crate) const SPLAT: Features = Features::ALTERNATE;

/// The kernel that draws surfels, and the targets of an image that they add up in.
#[derive(Debug)]
pub(crate) struct Splat {
    kernel: Kernel,
    /// Triangle vertices of one surfel.
    corners: u32,
    /// Weighted irradiance over pi of indirect light, with the sum of weights, and that of direct light.
    sums: [Target; 2],
}

impl Splat {
    /// `None` if pixels gather. Fails on a device that cannot draw, with what it lacks.
    pub(crate) fn new(gpu: &Gpu, apply: Apply, size: [u32; 2]) -> Result<Option<Self>, GpuError> {
        let (name, corners) = match apply {
            Apply::Gather => return Ok(None),
            Apply::Boxes => ("surfel_boxes", 36),
            Apply::Quads => ("surfel_quads", 6),
        };
        let target = |label| gpu.target(label, MemoryKind::View, size);
        // These kernels depend neither on the scene nor on its materials.
        let kernel = gpu.kernel(name, Features::NONE)?;
        Ok(Some(Self { kernel, corners, sums: [target("splat_indirect")?, target("splat_direct")?] }))
    }

    /// Draws every live surfel.
    pub(crate) fn record(
        &self,
        graph: &mut Graph,
        cache: &SurfelCache,
        uniforms: &SurfelUniforms,
        frame: &[u8],
        points: &Buffer,
    ) -> Result<(), GpuError> {
        let [indirect, direct] = &self.sums;
        // 2^22 surfels, the most that fit, have 36 * 2^22 corners: no overflow.
        let [live, _] = cache.counts();
        cache
            .bind_surfels(cache.bind(graph.pass(&self.kernel)))
            .uniform("cache", bytemuck::bytes_of(uniforms))
            .uniform("frame", frame)
            .bind("visible_points", points)
            .draw(live * self.corners, &[indirect, direct])
    }

    /// Binds the sums for a kernel that reads them.
    pub(crate) fn bind<'g>(&self, pass: PassBuilder<'g>) -> PassBuilder<'g> {
        let [indirect, direct] = &self.sums;
        pass.texture("splat_indirect", indirect).texture("splat_direct", direct)
    }
}

impl SurfelCache {
    /// Irradiance over pi (rgb) and the trust in it (w) at each visible point, `vec4f` by pixel, as a frame of `seed`
    /// would apply the cache; and the passes with their times: visibility, drawing where there is any, applying.
    #[allow(clippy::too_many_arguments, reason = "scene, lights and view are separate owners")]
    pub fn apply(
        &mut self,
        gpu: &Gpu,
        scene: &SceneBuffers,
        lights: &LightBuffers,
        view: &FrameView,
        features: Features,
        seed: u64,
        apply: Apply,
    ) -> Result<(Buffer, Vec<PassTime>), GpuError> {
        let splat = Splat::new(gpu, apply, view.size)?;
        let features = features.with(SPLAT, splat.is_some());
        let pixel_count = view.size[0] * view.size[1];
        let visibility = Visibility::new(gpu, view.size)?;
        let applied = gpu.buffer("applied", MemoryKind::View, u64::from(pixel_count) * 16)?;
        let camera = self.add_camera(false);
        self.set_camera(camera, CacheCamera::of_view(view, scene.origin, view.size), view.exposure);
        let uniforms = self.uniforms(0);
        self.remove_camera(camera);
        let mut frame = view.uniforms(scene, lights, features, seed);
        frame.sample_count = 1;
        let mut graph = gpu.graph("surfel_apply");
        visibility.record(&mut graph, &gpu.kernel(visibility::KERNEL, features)?, scene, lights, &frame)?;
        let frame = bytemuck::bytes_of(&frame);
        if let Some(splat) = &splat {
            splat.record(&mut graph, self, &uniforms, frame, &visibility.points)?;
        }
        let kernel = gpu.kernel("surfel_apply", features)?;
        let mut pass = self.bind(visibility.bind(graph.pass(&kernel))).uniform("frame", frame);
        if splat.is_none() {
            pass = pass.uniform("cache", bytemuck::bytes_of(&uniforms));
        }
        if let Some(splat) = &splat {
            pass = splat.bind(pass);
        }
        pass.bind("applied", &applied).dispatch(workgroups_of(pixel_count))?;
        let report = graph.submit()?.wait()?;
        Ok((applied, report.passes))
    }
}
