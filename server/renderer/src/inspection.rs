//! Why a point is as bright as it is: the surfels that light it.

use glam::DVec3;
use surfelcast_gpu::Gpu;
use surfelcast_passes::features::features_for;
use surfelcast_techniques::{FrameView, LightBuffers, MaterialMode, SceneBuffers, SurfelCache};

use crate::error::RendererError;

/// One surfel's part in a point's light.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize)]
pub struct Contribution {
    /// Surfel.
    pub id: u32,
    /// Share of the point's value; all shares add up to one.
    pub share: f32,
    /// Weight by distance and normal, before visibility and trust.
    pub weight: f32,
    /// Chance that the surfel sees the point, by radial depth.
    pub visibility: f32,
    /// World space.
    pub position: [f64; 3],
    /// World space.
    pub normal: [f32; 3],
    /// Metres.
    pub radius: f32,
    /// B of sky and emission found directly.
    pub direct: [f32; 3],
    /// B of light that has bounced at least once.
    pub indirect: [f32; 3],
    /// Rays behind the values.
    pub ray_count: f32,
    /// Standard error of the luminance of B.
    pub std_error: f32,
}

/// What the surfel cache knows of a point.
#[derive(Clone, Debug, Default, PartialEq, serde::Serialize)]
pub struct Inspection {
    /// World space.
    pub position: [f64; 3],
    /// World space, towards the viewer.
    pub normal: [f32; 3],
    /// Sum of weights.
    pub coverage: f32,
    /// Sum of weights that also count visibility and rays.
    pub trust: f32,
    /// B of sky and emission found directly.
    pub direct: [f32; 3],
    /// B of light that has bounced at least once.
    pub indirect: [f32; 3],
    /// Surfels, the largest share first; at most 64.
    pub contributions: Vec<Contribution>,
}

/// Asks the cache about the surface under a point of a picture.
pub(crate) fn inspect(
    gpu: &Gpu,
    scene: &SceneBuffers,
    lights: &LightBuffers,
    cache: &SurfelCache,
    view: FrameView,
    point: [f32; 2],
) -> Result<Option<Inspection>, RendererError> {
    let [width, height] = view.size.map(|side| side.max(1));
    let column = ((point[0] * width as f32) as u32).min(width - 1);
    let row = ((point[1] * height as f32) as u32).min(height - 1);
    let features = features_for(&scene.summary, MaterialMode::Pbr, lights.punctual_count > 0, false);
    let view = FrameView { size: [width, height], ..view };
    let Some((at, parts)) = cache.inspect(gpu, scene, lights, &view, features, row * width + column)? else {
        return Ok(None);
    };
    let world = |[x, y, z]: [f32; 3]| (scene.origin + DVec3::new(x.into(), y.into(), z.into())).to_array();
    let trust = |part: &surfelcast_techniques::SurfelContribution| {
        part.weight * part.visibility * (part.ray_count / surfelcast_techniques::FULL_TRUST).min(1.0)
    };
    let sum: f32 = parts.iter().map(trust).sum();
    let mut contributions: Vec<Contribution> = parts
        .iter()
        .map(|part| Contribution {
            id: part.id,
            share: if sum > 0.0 { trust(part) / sum } else { 0.0 },
            weight: part.weight,
            visibility: part.visibility,
            position: world(part.position),
            normal: surfelcast_scene::geometry::unpack_octahedral(part.normal).to_array(),
            radius: part.radius,
            direct: part.direct,
            indirect: part.indirect,
            ray_count: part.ray_count,
            std_error: part.variance.max(0.0).sqrt(),
        })
        .collect();
    contributions.sort_by(|a, b| b.share.total_cmp(&a.share).then(a.id.cmp(&b.id)));
    Ok(Some(Inspection {
        position: world(at.position),
        normal: surfelcast_scene::geometry::unpack_octahedral(at.normal).to_array(),
        coverage: at.radius,
        trust: at.weight,
        direct: at.direct,
        indirect: at.indirect,
        contributions,
    }))
}
