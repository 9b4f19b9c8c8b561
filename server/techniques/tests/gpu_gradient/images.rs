//! The results of the reconstruction.

use surfelcast_passes::poisson::Norm;
use surfelcast_techniques::gradient::{GradientTracer, Reconstruction};
use surfelcast_techniques::technique::{Technique as _, TechniqueOptions};
use surfelcast_techniques::{LightState, MaterialMode};

use crate::rig::{Mean, Rig, gpu};
use crate::rooms::{Paint, inside_of_box, scene};
use crate::scenes::{Setting, glossy, matte, settings};

const SIZE: [u32; 2] = [48, 36];

fn mean(values: &[[f32; 4]]) -> f64 {
    values.iter().flat_map(|v| &v[..3]).map(|&v| f64::from(v)).sum::<f64>() / (3.0 * values.len() as f64)
}

/// RMSE after the tone map of the error metric.
fn rmse(picture: &[[f32; 4]], truth: &[[f32; 4]]) -> f64 {
    let compress = |v: &[f32; 4]| {
        let scale = 1.0 / (1.0 + v[0].max(v[1]).max(v[2]).max(0.0));
        [v[0] * scale, v[1] * scale, v[2] * scale].map(f64::from)
    };
    let squares: f64 = picture
        .iter()
        .zip(truth)
        .map(|(a, b)| compress(a).iter().zip(compress(b)).map(|(a, b)| (a - b).powi(2)).sum::<f64>())
        .sum();
    (squares / (3.0 * picture.len() as f64)).sqrt()
}

/// The base paths are those of `path`: the same random numbers give the same image before reconstruction.
#[test]
fn values_are_those_of_path_tracing() {
    let gpu = gpu();
    for setting in settings() {
        let rig = Rig::new(&gpu, &setting, [40, 30]);
        let mut technique = rig.gradient(3, Reconstruction::None);
        rig.render(&mut technique, 8, u64::MAX);
        let (values, path) = (rig.read(technique.picture()), rig.picture("path", 3, 8));
        // A different rounding of the last bit may change a path; nearly all pixels must agree.
        let is_same =
            |(a, b): &(&[f32; 4], &[f32; 4])| (0..3).all(|i| (a[i] - b[i]).abs() <= 2e-3 * a[i].abs().max(0.01));
        let same = values.iter().zip(&path).filter(is_same).count();
        let off = mean(&values) / mean(&path) - 1.0;
        println!("{}: {same} of {} pixels agree, means by {:.3} %", setting.name, values.len(), 100.0 * off);
        assert!(same * 100 >= values.len() * 95 && off.abs() < 0.02, "{}: {same}, {off}", setting.name);
    }
}

/// A closed room that emits 1 - albedo and reflects albedo has radiance 1 everywhere, so all differences are 0.
#[test]
fn furnaces_stay_white() {
    let gpu = gpu();
    for albedo in [0.2, 0.8] {
        let paint = Paint { albedo, emission: 1.0 - albedo, is_unlit: false };
        let scene = scene(&inside_of_box([-1.0; 3], [1.0; 3], paint), 0.0);
        let lights = LightState::of_scene(&scene);
        let camera = surfelcast_scene::Camera {
            position: glam::DVec3::new(0.1, 0.05, 0.2),
            target: glam::DVec3::new(0.9, 0.2, -0.6),
            up: glam::DVec3::Y,
            vfov: 1.2,
        };
        let setting = Setting { name: "furnace", scene, lights, camera };
        let mut rig = Rig::new(&gpu, &setting, [32, 24]);
        rig.materials = MaterialMode::Lambert;
        for id in ["gradient", "gradient_l1"] {
            let picture = rig.picture(id, 1, 128);
            let off = (mean(&picture) - 1.0).abs();
            println!("albedo {albedo}, {id}: mean off by {:.3} %", 100.0 * off);
            assert!(off < 0.005, "albedo {albedo}, {id}: {off}");
        }
    }
}

#[test]
fn least_squares_keep_the_energy() {
    let gpu = gpu();
    for setting in [matte(), glossy()] {
        let rig = Rig::new(&gpu, &setting, SIZE);
        let mut technique = rig.gradient(5, Reconstruction::Poisson(Norm::L2));
        rig.render(&mut technique, 4, u64::MAX);
        let values = mean(&rig.read(technique.values())) + mean(&rig.read(technique.seen()));
        let picture = mean(&rig.read(technique.picture()));
        println!("{}: mean {values:.5} becomes {picture:.5}", setting.name);
        assert!((picture / values - 1.0).abs() < 0.005, "{}: {values} {picture}", setting.name);
    }
}

/// Over many seeds the mean of reconstructions of few samples is the truth: the energy is preserved at every pixel.
#[test]
fn reconstruction_has_no_bias() {
    let gpu = gpu();
    let setting = matte();
    let rig = Rig::new(&gpu, &setting, [24, 18]);
    let truth = rig.picture("path", 99, 8192);
    let mut sums = vec![Mean::default(); truth.len()];
    for seed in 0..32 {
        for (sum, pixel) in sums.iter_mut().zip(rig.picture("gradient", seed, 16)) {
            sum.add(f64::from(pixel[1]));
        }
    }
    let distances = sums.iter().zip(&truth).map(|(sum, truth)| (sum.mean() - f64::from(truth[1])) / sum.std_error());
    let rms = (distances.map(|d| d * d).sum::<f64>() / truth.len() as f64).sqrt();
    println!("distance of the mean of 32 reconstructions from the truth: {rms:.2} standard errors");
    assert!(rms < 1.35, "{rms}");
}

#[test]
fn differences_pay_at_equal_samples() {
    let gpu = gpu();
    for (setting, limit) in [(matte(), 0.5), (glossy(), 0.9)] {
        let rig = Rig::new(&gpu, &setting, SIZE);
        let truth = rig.picture("path", 99, 2048);
        for samples in [4, 16] {
            let error = |id: &str, samples: u32| {
                let mut technique = rig.technique(id, 7);
                let rays = rig.render(technique.as_mut(), samples, u64::MAX);
                (rmse(&rig.read(technique.picture()), &truth), rays)
            };
            let (path, path_rays) = error("path", samples);
            let (gradient, rays) = error("gradient", samples);
            let (robust, _) = error("gradient_l1", samples);
            let dearer = rays as f64 / path_rays as f64;
            let (equal, _) = error("path", (f64::from(samples) * dearer).round() as u32);
            println!(
                "{}, {samples} samples: path {path:.4}, gradient {gradient:.4}, L1 {robust:.4}; {dearer:.2} times the rays, \
                 path at equal rays {equal:.4}",
                setting.name
            );
            assert!(gradient < limit * path, "{}: {gradient} {path}", setting.name);
        }
    }
}

/// The same request gives the same bytes, however it is cut into submissions.
#[test]
fn pieces_change_nothing() {
    let gpu = gpu();
    let setting = glossy();
    let rig = Rig::new(&gpu, &setting, SIZE);
    for id in ["gradient", "gradient_l1"] {
        let pictures = [u64::MAX, 4096, 1].map(|max_paths| {
            let mut technique = rig.technique(id, 2);
            rig.render(technique.as_mut(), 4, max_paths);
            rig.read(technique.picture())
        });
        let bytes = pictures.each_ref().map(|picture| bytemuck::cast_slice::<_, u8>(picture.as_slice()));
        assert!(bytes[0] == bytes[1] && bytes[1] == bytes[2], "{id}");
    }
}

/// The first image comes from the general kernels; those that fit the scene replace them during an accumulation.
#[test]
fn the_general_kernels_render_the_same() {
    let gpu = gpu();
    let setting = glossy();
    let rig = Rig::new(&gpu, &setting, SIZE);
    let options = TechniqueOptions { waits_for_kernels: false, ..rig.options(4) };
    let mut early = GradientTracer::new(&gpu, &rig.buffers, &rig.lights, options, Reconstruction::None).unwrap();
    rig.render(&mut early, 4, 1024);
    let mut late = rig.gradient(4, Reconstruction::None);
    rig.render(&mut late, 4, 1024);
    for (early, late) in [(early.picture(), late.picture()), (early.differences(), late.differences())] {
        let (early, late) = (rig.read(early), rig.read(late));
        let is_same =
            |(a, b): &(&[f32; 4], &[f32; 4])| (0..3).all(|i| (a[i] - b[i]).abs() <= 2e-3 * a[i].abs().max(0.01));
        let same = early.iter().zip(&late).filter(is_same).count();
        assert!(same * 100 >= early.len() * 95, "{same} of {}", early.len());
    }
}
