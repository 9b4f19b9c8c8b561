//! What the technique keeps for a session: the cache, and a saved one until it is first needed.

use std::sync::Arc;

use glam::DVec3;
use parking_lot::Mutex;
use surfelcast_gpu::{Gpu, GpuError};
use surfelcast_passes::features::features_for;
use surfelcast_passes::frame::FrameView;
use surfelcast_passes::lights::LightBuffers;
use surfelcast_passes::materials::MaterialMode;
use surfelcast_passes::upload::SceneBuffers;
use surfelcast_render_api::{Column, Disc, Field, Inspection, Row, Value};
use surfelcast_scene::geometry::unpack_octahedral;
use surfelcast_shaders::records::SurfelContribution;

use crate::session::{SessionState, SnapshotIdentity, TechniqueSession, own};
use crate::surfel::cache::SurfelCache;
use crate::surfel::{ENTRY, FULL_TRUST, ViewOptions, ply};
use crate::technique::{Change, TechniqueError};

/// The session's cache with the materials that it was made for, and a saved one.
#[derive(Debug, Default)]
pub(crate) struct SurfelSession {
    /// A cache as it was saved, until one is first needed.
    saved: Mutex<Option<(SnapshotIdentity, Vec<u8>)>>,
    cache: Mutex<Option<(MaterialMode, Arc<Mutex<SurfelCache>>)>>,
}

impl SurfelSession {
    /// The cache, made when first needed. Other settings or materials make a new one.
    pub(crate) fn cache(
        &self,
        gpu: &Gpu,
        scene: &SceneBuffers,
        options: &ViewOptions,
    ) -> Result<Arc<Mutex<SurfelCache>>, GpuError> {
        let ViewOptions { materials, surfel: settings, seed, full_size: [width, height], .. } = *options;
        let pixel_count = width.saturating_mul(height);
        let mut held = self.cache.lock();
        if let Some((of, cache)) = &*held
            && *of == materials
            && cache.lock().settings().of_cache() == settings.of_cache()
        {
            return Ok(Arc::clone(cache));
        }
        // The old one is freed first, so that the new one may take its place.
        *held = None;
        let restored = self.saved.lock().take().and_then(|(identity, bytes)| {
            let restored = SurfelCache::restore(gpu, scene, settings, pixel_count, seed, &identity, &bytes);
            restored.inspect_err(|reason| tracing::warn!(%reason, "a saved surfel cache is not used")).ok()
        });
        let cache = match restored {
            Some(cache) => cache,
            None => SurfelCache::new(gpu, scene, settings, pixel_count, seed)?,
        };
        let cache = Arc::new(Mutex::new(cache));
        *held = Some((materials, Arc::clone(&cache)));
        Ok(cache)
    }

    /// The cache, if there is one by now.
    fn existing(&self) -> Option<Arc<Mutex<SurfelCache>>> {
        self.cache.lock().as_ref().map(|(_, cache)| Arc::clone(cache))
    }
}

/// The surfel cache of a session, if it has one by now.
pub fn cache_of(session: &SessionState) -> Option<Arc<Mutex<SurfelCache>>> {
    let part = session.of(&ENTRY);
    own::<SurfelSession>(part.as_ref(), ENTRY.id()).ok()?.existing()
}

impl TechniqueSession for SurfelSession {
    fn invalidate(&self, change: Change) {
        match (change, self.existing()) {
            (Change::Camera, _) | (_, None) => {}
            // Means are forgotten as first guesses; places stay, since surfels do not follow objects yet.
            (Change::Lights | Change::Transforms, Some(cache)) => cache.lock().relight(),
        }
    }

    fn inspect(
        &self,
        gpu: &Gpu,
        scene: &SceneBuffers,
        lights: &LightBuffers,
        view: &FrameView,
        [column, row]: [u32; 2],
    ) -> Result<Option<Inspection>, TechniqueError> {
        let Some(cache) = self.existing() else { return Ok(None) };
        let features = features_for(&scene.summary, MaterialMode::Pbr, lights.punctual_count > 0, false);
        let pixel = row * view.size[0] + column;
        let found = cache.lock().inspect(gpu, scene, lights, view, features, pixel)?;
        Ok(found.map(|(at, parts)| explain(scene.origin, &at, &parts)))
    }

    fn save(&self, gpu: &Gpu, identity: &SnapshotIdentity) -> Result<Option<Vec<u8>>, TechniqueError> {
        let Some(cache) = self.existing() else { return Ok(None) };
        let bytes = cache.lock().save(gpu, identity)?;
        Ok(Some(bytes))
    }

    fn restore(&self, identity: SnapshotIdentity, bytes: Vec<u8>) {
        *self.saved.lock() = Some((identity, bytes));
    }

    fn export(&self, gpu: &Gpu, scene: &SceneBuffers) -> Result<Option<Vec<u8>>, TechniqueError> {
        let Some(cache) = self.existing() else { return Ok(None) };
        let surfels = cache.lock().export(gpu)?;
        Ok(Some(ply::encode(&surfels, scene.origin)))
    }
}

/// What each row says of a surfel.
const COLUMNS: [Column; 9] = [
    Column { id: "id", label: "Surfel", unit: "" },
    Column { id: "share", label: "Share", unit: "share" },
    Column { id: "ray_count", label: "Rays", unit: "count" },
    Column { id: "radius", label: "Radius", unit: "m" },
    Column { id: "std_error", label: "Error", unit: "" },
    Column { id: "weight", label: "Weight", unit: "" },
    Column { id: "visibility", label: "Visibility", unit: "" },
    Column { id: "direct", label: "Direct", unit: "" },
    Column { id: "indirect", label: "Indirect", unit: "" },
];

/// The surfels behind a point's light, the largest share first. All shares add up to one.
fn explain(origin: DVec3, at: &SurfelContribution, parts: &[SurfelContribution]) -> Inspection {
    let world = |[x, y, z]: [f32; 3]| (origin + DVec3::new(x.into(), y.into(), z.into())).to_array();
    let trust = |part: &SurfelContribution| part.weight * part.visibility * (part.ray_count / FULL_TRUST).min(1.0);
    let sum: f32 = parts.iter().map(trust).sum();
    let mut shares: Vec<(f32, &SurfelContribution)> =
        parts.iter().map(|part| (if sum > 0.0 { trust(part) / sum } else { 0.0 }, part)).collect();
    shares.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.id.cmp(&b.1.id)));
    let row = |&(share, part): &(f32, &SurfelContribution)| Row {
        values: vec![
            Value::Count(part.id),
            Value::Number(share),
            Value::Number(part.ray_count),
            Value::Number(part.radius),
            Value::Number(part.variance.max(0.0).sqrt()),
            Value::Number(part.weight),
            Value::Number(part.visibility),
            Value::Triple(part.direct),
            Value::Triple(part.indirect),
        ],
        disc: Some(Disc {
            position: world(part.position),
            normal: unpack_octahedral(part.normal).to_array(),
            radius: part.radius,
        }),
    };
    let field = |id, label, value| Field { id, label, unit: "", value };
    let both = [0, 1, 2].map(|channel| at.direct[channel] + at.indirect[channel]);
    Inspection {
        position: world(at.position),
        normal: unpack_octahedral(at.normal).to_array(),
        headline: match shares.len() {
            0 => "No surfel lights this point yet.".to_owned(),
            1 => "1 surfel lights this point.".to_owned(),
            count => format!("{count} surfels light this point."),
        },
        summary: vec![
            field("coverage", "Coverage", Value::Number(at.radius)),
            field("trust", "Trust", Value::Number(at.weight)),
            field("light", "Irradiance / π", Value::Triple(both)),
            field("direct", "Direct", Value::Triple(at.direct)),
            field("indirect", "Indirect", Value::Triple(at.indirect)),
        ],
        columns: COLUMNS.to_vec(),
        rows: shares.iter().map(row).collect(),
    }
}

#[cfg(test)]
mod tests {
    use surfelcast_shaders::layout::bytemuck::Zeroable as _;

    use super::*;

    #[test]
    fn shares_add_up_to_one_and_the_largest_comes_first() {
        let part = |id, weight| SurfelContribution {
            id,
            weight,
            visibility: 1.0,
            ray_count: FULL_TRUST,
            radius: 0.5,
            variance: 0.25,
            ..SurfelContribution::zeroed()
        };
        let at = SurfelContribution { direct: [1.0; 3], indirect: [0.5; 3], ..SurfelContribution::zeroed() };
        let found = explain(DVec3::new(1e6, 0.0, 0.0), &at, &[part(3, 1.0), part(7, 3.0)]);
        assert_eq!((found.position, found.headline.as_str()), ([1e6, 0.0, 0.0], "2 surfels light this point."));
        let values = |column: &str| -> Vec<Value> {
            let index = found.columns.iter().position(|known| known.id == column).expect("a column");
            found.rows.iter().map(|row| row.values[index]).collect()
        };
        assert_eq!(values("id"), [Value::Count(7), Value::Count(3)]);
        assert_eq!(values("share"), [Value::Number(0.75), Value::Number(0.25)]);
        assert_eq!(values("std_error"), [Value::Number(0.5); 2]);
        assert!(found.rows.iter().all(|row| row.values.len() == found.columns.len()));
        assert!(found.summary.iter().any(|field| field.id == "light" && field.value == Value::Triple([1.5; 3])));
        let none = explain(DVec3::ZERO, &at, &[]);
        assert_eq!((none.rows.len(), none.headline.as_str()), (0, "No surfel lights this point yet."));
    }
}
