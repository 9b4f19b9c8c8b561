//! `surfel`: a persistent cache of indirect light on discs all over the scene, shared by every camera of a session.
//!
//! The cache ([`SurfelCache`], in `cache/`) belongs to the session ([`crate::SessionState`]); a technique object is one
//! view of it (`view/`). Whichever view comes first drives the next update, so several pay for the rays once. The
//! stages of a frame are in `frame.rs`, the kernels are described in `shaders/techniques/surfel/README.md`.

mod cache;
mod frame;
mod settings;
mod view;

pub use cache::{ExportedSurfel, MeasuredDifference, SnapshotError, SnapshotIdentity, SurfelCache};
pub use settings::{Apply, Estimator, Grid, ImageScheme, Initial, KNOBS, Knob, Reconstruction, SurfelSettings};
pub use view::SurfelOutput;

use surfelcast_passes::visibility;

use crate::surfel::view::SurfelView;
use crate::technique::{Conformance, TechniqueEntry};

/// Registry line.
pub const ENTRY: TechniqueEntry = TechniqueEntry {
    id: "surfel",
    label: "Surfel cache",
    summary: "Real-time default: indirect light from a cache that all views share and that stays.",
    conformance: |settings| {
        if settings.settles { Conformance::Consistent } else { Conformance::Biased { rmse_tonemapped: 0.03 } }
    },
    kernels: kernels_for,
    uses_surfels: true,
    needs: |_| Ok(()),
    create: |gpu, scene, lights, session, options| Ok(Box::new(SurfelView::new(gpu, scene, lights, session, options)?)),
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
