//! The audit is unbiased, and its intervals contain the truth as often as promised, in a room without caustics.

use surfelcast_techniques::surfel::{Reconstruction, SurfelSettings};
use surfelcast_techniques::technique::TechniqueOptions;
use surfelcast_techniques::{Audit, AuditResult, SessionState, registry};

use crate::rig::{Mean, Rig, gpu};
use crate::scenes::{Setting, matte};

const SIZE: [u32; 2] = [48, 36];
/// Images, each with a seed of its own for itself and its audit.
const PICTURES: u64 = 100;
/// Samples per pixel of each of the two images that represent the truth.
const TRUTH_SAMPLES: u32 = 1024;

fn tone_mapped(picture: &[[f32; 4]]) -> Vec<[f64; 3]> {
    let compress = |v: &[f32; 4]| {
        let scale = 1.0 / (1.0 + f64::from(v[0].max(v[1]).max(v[2]).max(0.0)));
        [v[0], v[1], v[2]].map(|c| f64::from(c) * scale)
    };
    picture.iter().map(compress).collect()
}

/// Mean squared error against the truth, from two images of it whose independent noise cancels in the product.
fn measured(picture: &[[f32; 4]], truths: &[Vec<[f64; 3]>; 2]) -> f64 {
    let products = tone_mapped(picture)
        .into_iter()
        .zip(truths[0].iter().zip(&truths[1]))
        .map(|(x, (a, b))| (0..3).map(|i| (x[i] - a[i]) * (x[i] - b[i])).sum::<f64>());
    products.sum::<f64>() / (3.0 * picture.len() as f64)
}

/// Renders and audits many images. Returns audited and measured errors.
fn audits(setting: &Setting, technique: &str, samples: u32) -> Vec<(AuditResult, f64)> {
    let gpu = gpu();
    let rig = Rig::new(&gpu, setting, SIZE);
    let truths = [1 << 20, 1 << 21].map(|seed| tone_mapped(&rig.picture("path", seed, TRUTH_SAMPLES)));
    let entry = registry::by_id(technique).unwrap();
    // A coarse cache without reconstruction: its error is large enough for a hundred audits to resolve.
    let surfel = SurfelSettings {
        radius_pixels: 16.0,
        reconstruction: Reconstruction::None,
        shares: false,
        // The least number of rays that an update traces: if it were above the configured one, frames would take more
        // samples per pixel.
        rays_per_pixel: 2.0,
        ..SurfelSettings::PREVIEW
    };
    (0..PICTURES)
        .map(|seed| {
            let options = TechniqueOptions { settings: surfel.into(), ..rig.options(seed) };
            let session = SessionState::default();
            let mut picture = entry.start(&gpu, &rig.buffers, &rig.lights, &session, options).unwrap();
            rig.render(picture.as_mut(), samples, u64::MAX);
            let mut audit = Audit::new(&gpu, picture.features(), SIZE, seed).unwrap();
            let buffer = picture.picture();
            let found = audit.run(&gpu, &rig.buffers, &rig.lights, &rig.view, buffer, samples, 1.0).unwrap();
            (found, measured(&rig.read(buffer), &truths))
        })
        .collect()
}

fn check(setting: &Setting, technique: &str, samples: u32) {
    let audits = audits(setting, technique, samples);
    let (mut truth, mut difference, mut stated) = (Mean::default(), Mean::default(), Mean::default());
    let (mut below, mut above) = (0, 0);
    for (found, measured) in &audits {
        truth.add(*measured);
        difference.add(found.mse - measured);
        stated.add(((found.mse - measured) / found.mse_std_error).powi(2));
        let rmse = measured.max(0.0).sqrt();
        above += u64::from(found.rmse_interval[0] > rmse);
        below += u64::from(found.rmse_interval[1] < rmse);
    }
    let ratio = 1.0 + difference.mean() / truth.mean();
    let std_error = difference.std_error() / truth.mean();
    let inside = PICTURES - below - above;
    println!(
        "{}, {technique}, {samples} samples: RMSE {:.5}, audited MSE {ratio:.4} +- {std_error:.4} of the measured one; \
         {inside} of {PICTURES} intervals hold the truth, {below} lie below it and {above} above; deviations are {:.2} of the \
         stated standard errors",
        setting.name,
        truth.mean().sqrt(),
        stated.mean().sqrt()
    );
    assert!(std_error < 0.1, "{}, {technique}: {std_error} is too uncertain to show anything", setting.name);
    assert!((ratio - 1.0).abs() < 3.0 * std_error, "{}, {technique}: {ratio} +- {std_error}", setting.name);
    assert!(inside * 10 >= PICTURES * 9, "{}, {technique}: {inside} of {PICTURES}", setting.name);
}

#[test]
fn of_path_traced_images() {
    check(&matte(), "path", 16);
}

#[test]
fn of_images_from_surfels() {
    check(&matte(), "surfel", 4);
}
