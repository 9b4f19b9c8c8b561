//! `surfel`: a persistent cache of indirect light on discs all over the scene, shared by every camera of a session.
//!
//! The cache ([`SurfelCache`], in `cache/`) belongs to the session ([`crate::SessionState`]); a technique object is one
//! view of it (`view/`). Whichever view comes first drives the next update, so several pay for the rays once. The
//! stages of a frame are in `frame.rs`, the kernels are described in `shaders/techniques/surfel/README.md`.

mod cache;
mod frame;
mod outputs;
mod ply;
mod session;
mod settings;
mod settings_table;
mod view;

use std::sync::Arc;

use surfelcast_passes::materials::MaterialMode;
use surfelcast_passes::visibility;
use surfelcast_render_api::TechniqueDescription;

pub use cache::{ExportedSurfel, MeasuredDifference, SnapshotError, SurfelCache};
pub use session::cache_of;
pub use settings::{Apply, Estimator, Grid, ImageScheme, Initial, Reconstruction, SurfelSettings};
pub use surfelcast_shaders::constants::SURFEL_FULL_TRUST as FULL_TRUST;
pub use surfelcast_shaders::records::SurfelContribution;
pub use view::SurfelOutput;

use crate::session::own;
use crate::surfel::session::SurfelSession;
use crate::surfel::view::SurfelView;
use crate::technique::{Conformance, TechniqueEntry, TechniqueOptions};

/// Options of one image with the settings read.
#[derive(Clone, Copy, Debug)]
pub(crate) struct ViewOptions {
    pub(crate) size: [u32; 2],
    pub(crate) full_size: [u32; 2],
    pub(crate) materials: MaterialMode,
    pub(crate) is_split: bool,
    pub(crate) seed: u64,
    pub(crate) waits_for_kernels: bool,
    pub(crate) surfel: SurfelSettings,
}

impl From<&TechniqueOptions> for ViewOptions {
    fn from(options: &TechniqueOptions) -> Self {
        Self {
            size: options.size,
            full_size: options.full_size,
            materials: options.materials,
            is_split: options.is_split,
            seed: options.seed,
            waits_for_kernels: options.waits_for_kernels,
            surfel: (&options.settings).into(),
        }
    }
}

/// Registry line.
pub const ENTRY: TechniqueEntry = TechniqueEntry {
    description: TechniqueDescription {
        id: "surfel",
        label: "Surfel cache",
        summary: "Real-time default: indirect light from a cache that all views share and that stays.",
        aliases: &[],
        settings: &settings_table::SETTINGS,
        presets: settings::PRESETS,
        outputs: outputs::OUTPUTS,
        export: Some(
            "the surfels as a PLY point cloud: position, normal, radius, irradiance over pi, rays, variance, age",
        ),
    },
    conformance: |settings| {
        if SurfelSettings::from(settings).settles {
            Conformance::Consistent
        } else {
            Conformance::Biased { rmse_tonemapped: 0.03 }
        }
    },
    kernels: |settings| kernels_for(&settings.into()),
    needs: |_| Ok(()),
    create: |gpu, scene, lights, session, options| {
        let session: &SurfelSession = own(session, "surfel")?;
        Ok(Box::new(SurfelView::new(gpu, scene, lights, session, (&options).into())?))
    },
    open_session: || Arc::new(SurfelSession::default()),
};

/// Kernels of every view.
const KERNELS: &[&str] = &[
    visibility::KERNEL,
    "surfel_coverage",
    "surfel_trace",
    "surfel_shade",
    "surfel_claim",
    "surfel_reject",
    "surfel_spawn",
    "surfel_probe",
    "surfel_mark",
    "surfel_compact",
    "surfel_grid_count",
    "surfel_grid_scatter",
    "surfel_grid_sort",
    "surfel_relight",
    "surfel_request",
    "surfel_rays",
    "surfel_integrate",
    "surfel_recycle",
];

/// Kernels of a view with these settings, and no more.
fn kernels_for(settings: &SurfelSettings) -> Vec<&'static str> {
    let optional = [
        (settings.reconstruction.shows_means(), &["surfel_share"][..]),
        (!settings.reconstruction.shows_means(), cache::VALUE_KERNELS),
        (settings.reconstruction.uses_graph(), cache::KERNELS),
        (settings.reconstruction.measures_differences(), cache::DIFFERENCE_KERNELS),
        (settings.reconstruction == Reconstruction::Poisson, cache::SOLVE_KERNELS),
        (settings.reconstruction == Reconstruction::Image, view::IMAGE_KERNELS),
        (settings.bins_rays, &["surfel_bin_count", "surfel_bin_scatter"]),
        (settings.initial != Initial::Gaps, &["surfel_seed"]),
    ];
    let chosen = optional.iter().filter(|(is_needed, _)| *is_needed).flat_map(|(_, names)| *names);
    KERNELS.iter().chain(chosen).copied().collect()
}
