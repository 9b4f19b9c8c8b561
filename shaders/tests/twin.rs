//! The CPU twins against closed forms: densities integrate to one and match the samples, values are reciprocal, energy
//! is conserved. Kernels are compared with the twins on a device.

use std::f32::consts::PI;

use glam::{Vec2, Vec3};
use surfelcast_shaders::twin::bsdf::Evaluation;
use surfelcast_shaders::twin::bsdf::dielectric::{Dielectric, evaluate_dielectric, reflectance};
use surfelcast_shaders::twin::bsdf::fresnel::{fresnel_dielectric, fresnel_schlick};
use surfelcast_shaders::twin::bsdf::lambert::evaluate_lambert;
use surfelcast_shaders::twin::bsdf::metallic_roughness::{
    MetallicRoughness, evaluate_metallic_roughness, metallic_roughness, sample_metallic_roughness,
};
use surfelcast_shaders::twin::bsdf::microfacet::{
    ggx_distribution, ggx_masking, ggx_visible_pdf, sample_ggx_visible_normal,
};
use surfelcast_shaders::twin::core::math::{frame_around, normalize_or};
use surfelcast_shaders::twin::core::rng::{PathKey, pcg4d, random_for_triangle, random4};
use surfelcast_shaders::twin::core::sampling::{
    cosine_hemisphere_pdf_solid_angle, power_heuristic, sample_cosine_hemisphere, sample_triangle,
};
use surfelcast_shaders::twin::scene::environment::{
    environment_direction, environment_pdf_solid_angle, environment_uv,
};
use surfelcast_shaders::twin::scene::lights::{spot_falloff, triangle_pdf_solid_angle};

/// Integral over the sphere by the midpoint rule in (theta, phi): finest around the pole, where the lobes are.
fn integrate(rows: u32, integrand: impl Fn(Vec3) -> f64) -> f64 {
    let columns = rows;
    let (dtheta, dphi) = (std::f64::consts::PI / f64::from(rows), 2.0 * std::f64::consts::PI / f64::from(columns));
    let mut sum = 0.0;
    for row in 0..rows {
        let (radius, z) = ((f64::from(row) + 0.5) * dtheta).sin_cos();
        for column in 0..columns {
            let phi = (f64::from(column) + 0.5) * dphi;
            let direction = Vec3::new((radius * phi.cos()) as f32, (radius * phi.sin()) as f32, z as f32);
            sum += integrand(direction) * radius;
        }
    }
    sum * dtheta * dphi
}

/// Jittered points of the unit square with a third number from the hash.
fn points(side: u32) -> impl Iterator<Item = Vec3> {
    (0..side * side).map(move |index| {
        let [jx, jy, u, _] = random4(PathKey { pixel: index, sample: 0, seed: [7, 11] }, 0);
        let cell = Vec2::new((index % side) as f32, (index / side) as f32);
        let place = (cell + Vec2::new(jx, jy)) / side as f32;
        Vec3::new(place.x, place.y, u)
    })
}

fn direction(cos_theta: f32, phi: f32) -> Vec3 {
    let sin_theta = (1.0 - cos_theta * cos_theta).max(0.0).sqrt();
    Vec3::new(sin_theta * phi.cos(), sin_theta * phi.sin(), cos_theta)
}

fn near(what: &str, found: f64, expected: f64, tolerance: f64) {
    assert!((found - expected).abs() <= tolerance, "{what}: {found} is not within {tolerance} of {expected}");
}

const COSINES: [f32; 4] = [1.0, 0.8, 0.4, 0.1];
const ROUGHNESSES: [f32; 3] = [1.0, 0.6, 0.35];

#[test]
fn the_hash_fills_the_unit_interval_and_depends_on_every_word() {
    let key = PathKey { pixel: 3, sample: 5, seed: [1, 2] };
    let base = random4(key, 0);
    for other in [
        random4(PathKey { pixel: 4, ..key }, 0),
        random4(PathKey { sample: 6, ..key }, 0),
        random4(PathKey { seed: [2, 2], ..key }, 0),
        random4(PathKey { seed: [1, 3], ..key }, 0),
        random4(key, 1),
    ] {
        assert!(base.iter().zip(other).all(|(a, b)| *a != b));
    }
    let draws: Vec<f32> = (0..100_000).flat_map(|pixel| random4(PathKey { pixel, ..key }, 9)).collect();
    assert!(draws.iter().all(|&u| (0.0..1.0).contains(&u)));
    let mean = draws.iter().map(|&u| f64::from(u)).sum::<f64>() / draws.len() as f64;
    near("mean", mean, 0.5, 4.0 * (1.0 / 12.0_f64 / draws.len() as f64).sqrt());
    assert_ne!(random_for_triangle(key, 0, 1), random_for_triangle(key, 0, 2));
    assert_eq!(pcg4d([0; 4]), pcg4d([0; 4]));
    // The largest word stays below one.
    assert!((u32::MAX >> 8) as f32 * 5.960_464_5e-8 < 1.0);
}

#[test]
fn frames_are_right_handed_and_orthonormal_in_every_direction() {
    for u in points(40) {
        let n = normalize_or(direction(u.x * 2.0 - 1.0, u.y * 2.0 * PI), Vec3::Z);
        let frame = frame_around(n);
        assert!((frame.determinant() - 1.0).abs() < 1e-5, "{n}");
        assert!((frame.transpose() * frame).abs_diff_eq(glam::Mat3::IDENTITY, 1e-5), "{n}");
        assert_eq!(frame.z_axis, n);
    }
    for pole in [Vec3::Z, -Vec3::Z, Vec3::new(0.0, 1e-30, -1.0)] {
        assert!(frame_around(pole).is_finite(), "{pole}");
    }
    assert_eq!(normalize_or(Vec3::splat(1e-30), Vec3::X), Vec3::splat(1.0 / 3.0_f32.sqrt()));
    assert_eq!(normalize_or(Vec3::ZERO, Vec3::X), Vec3::X);
    assert_eq!(normalize_or(Vec3::splat(f32::NAN), Vec3::X), Vec3::X);
}

#[test]
fn the_cosine_sampler_has_its_density_and_mean() {
    near("integral", integrate(512, |w| f64::from(cosine_hemisphere_pdf_solid_angle(w.z))), 1.0, 1e-4);
    // E[z] under cos/pi is 2/3.
    let mean = points(200).map(|u| f64::from(sample_cosine_hemisphere(Vec2::new(u.x, u.y)).z)).sum::<f64>() / 40_000.0;
    near("mean cosine", mean, 2.0 / 3.0, 1e-4);
    assert!(points(50).all(|u| (sample_cosine_hemisphere(Vec2::new(u.x, u.y)).length() - 1.0).abs() < 1e-5));
}

#[test]
fn triangle_points_lie_inside_and_average_to_the_centroid() {
    let mut sum = Vec3::ZERO;
    for u in points(200) {
        let weights = sample_triangle(Vec2::new(u.x, u.y));
        assert!(weights.min_element() >= 0.0 && (weights.element_sum() - 1.0).abs() < 1e-5, "{weights}");
        sum += weights / 40_000.0;
    }
    assert!(sum.abs_diff_eq(Vec3::splat(1.0 / 3.0), 1e-3), "{sum}");
}

#[test]
fn the_power_heuristic_shares_one() {
    for (a, b) in [(1.0, 1.0), (0.3, 7.0), (1e20, 1e-20), (5.0, 0.0), (1e30, 1e30)] {
        near("sum", f64::from(power_heuristic(a, b) + power_heuristic(b, a)), 1.0, 1e-6);
    }
    assert_eq!(power_heuristic(0.0, 0.0), 0.0);
    assert_eq!(power_heuristic(1.0, f32::INFINITY), 0.0);
}

#[test]
fn visible_normals_integrate_to_one_and_project_to_the_cosine() {
    for roughness in ROUGHNESSES {
        let alpha = roughness * roughness;
        // Projected area of all microfacets is that of the surface.
        let projected = integrate(500, |h| f64::from(if h.z > 0.0 { ggx_distribution(h.z, alpha) * h.z } else { 0.0 }));
        near("projected area", projected, 1.0, 2e-3);
        for cos_o in COSINES {
            let wo = direction(cos_o, 0.7);
            let visible = integrate(500, |h| f64::from(if h.z > 0.0 { ggx_visible_pdf(wo, h, alpha) } else { 0.0 }));
            near("visible normals", visible, 1.0, 4e-3);
            // Mean of a smooth function of the normal, drawn and integrated.
            let drawn =
                points(300).map(|u| f64::from(sample_ggx_visible_normal(wo, alpha, Vec2::new(u.x, u.y)).z.powi(2)));
            let drawn = drawn.sum::<f64>() / 90_000.0;
            let integral =
                integrate(500, |h| f64::from(if h.z > 0.0 { ggx_visible_pdf(wo, h, alpha) * h.z * h.z } else { 0.0 }));
            near("mean of z^2", drawn, integral, 4e-3);
        }
    }
    assert_eq!(ggx_masking(1.0, 0.5), 1.0);
}

fn materials() -> Vec<(f32, f32)> {
    let metallic = [0.0, 0.5, 1.0];
    ROUGHNESSES.iter().flat_map(|&roughness| metallic.map(|metallic| (metallic, roughness))).collect()
}

fn white(metallic: f32, roughness: f32, cos_o: f32) -> MetallicRoughness {
    metallic_roughness(Vec3::ONE, metallic, roughness, 1.5, cos_o)
}

#[test]
fn the_metallic_roughness_density_matches_what_is_drawn() {
    for (metallic, roughness) in materials() {
        for cos_o in COSINES {
            let wo = direction(cos_o, -1.0);
            let lobes = metallic_roughness(Vec3::new(0.9, 0.5, 0.2), metallic, roughness, 1.5, cos_o);
            let above = points(300).filter(|&u| sample_metallic_roughness(&lobes, wo, u).z > 0.0).count();
            let integral = integrate(400, |wi| f64::from(evaluate_metallic_roughness(&lobes, wo, wi).pdf_solid_angle));
            near(&format!("{metallic} {roughness} {cos_o}"), integral, above as f64 / 90_000.0, 8e-3);
            // The estimator value / pdf has the integral of the value as its mean.
            let mut mean = Vec3::ZERO;
            for u in points(300) {
                let wi = sample_metallic_roughness(&lobes, wo, u);
                let Evaluation { value, pdf_solid_angle } = evaluate_metallic_roughness(&lobes, wo, wi);
                if pdf_solid_angle > 0.0 {
                    mean += value / pdf_solid_angle / 90_000.0;
                }
            }
            let albedo = integrate(400, |wi| f64::from(evaluate_metallic_roughness(&lobes, wo, wi).value.x));
            near(&format!("albedo {metallic} {roughness} {cos_o}"), f64::from(mean.x), albedo, 8e-3);
        }
    }
}

#[test]
fn reflection_is_reciprocal() {
    for (metallic, roughness) in materials() {
        for u in points(12) {
            let (wo, wi) = (direction(u.x.max(0.05), 0.3), direction(u.y.max(0.05), u.z * 6.0));
            // The choice of lobe depends on wo, their values do not.
            let lobes = white(metallic, roughness, 0.5);
            let there = evaluate_metallic_roughness(&lobes, wo, wi).value / wi.z;
            let back = evaluate_metallic_roughness(&lobes, wi, wo).value / wo.z;
            assert!(there.abs_diff_eq(back, 1e-4 * there.max_element().max(1.0)), "{wo} {wi}: {there} {back}");
        }
    }
}

#[test]
fn white_materials_reflect_no_more_than_they_get_and_smooth_ones_all() {
    for cos_o in COSINES {
        let wo = direction(cos_o, 2.0);
        near("lambert", integrate(512, |wi| f64::from(evaluate_lambert(Vec3::ONE, wi).value.y)), 1.0, 1e-4);
        for (metallic, roughness) in materials() {
            let lobes = white(metallic, roughness, cos_o);
            let albedo = integrate(400, |wi| f64::from(evaluate_metallic_roughness(&lobes, wo, wi).value.y));
            // In glTF the albedo may exceed one if both lobes are white: the diffuse lobe is reduced by the reflectance
            // of the microfacet between the directions, not by that of the whole coat, which is larger at grazing
            // angles. The excess is bounded by the reflectance of the coat.
            let gain = if metallic == 1.0 { 0.003 } else { f64::from(fresnel_schlick(lobes.f0, cos_o).x) };
            assert!(albedo <= 1.0 + gain, "{metallic} {roughness} {cos_o}: {albedo}");
        }
        // A mirror-like white metal loses no energy to single scattering; its lobe is too thin to integrate on a grid.
        let mirror = white(1.0, 0.05, cos_o);
        let mut mean = 0.0;
        for u in points(100) {
            let wi = sample_metallic_roughness(&mirror, wo, u);
            let drawn = evaluate_metallic_roughness(&mirror, wo, wi);
            if drawn.pdf_solid_angle > 0.0 {
                mean += f64::from(drawn.value.y / drawn.pdf_solid_angle) / 10_000.0;
            }
        }
        near("mirror", mean, 1.0, 3e-3);
    }
}

#[test]
fn fresnel_has_its_known_values() {
    near("normal incidence", f64::from(fresnel_dielectric(1.0, 1.5)), 0.04, 1e-6);
    near("grazing", f64::from(fresnel_dielectric(1e-4, 1.5)), 1.0, 1e-2);
    assert_eq!(fresnel_dielectric(0.2, 1.0 / 1.5), 1.0, "total reflection");
    near("no boundary", f64::from(fresnel_dielectric(0.3, 1.0)), 0.0, 1e-6);
    // Both sides of a boundary have the same reflectance along the same path.
    for cos_o in COSINES {
        let cos_t = (1.0 - (1.0 - cos_o * cos_o) / 2.25_f32).sqrt();
        near(
            "both ways",
            f64::from(fresnel_dielectric(cos_o, 1.5)),
            f64::from(fresnel_dielectric(cos_t, 1.0 / 1.5)),
            1e-5,
        );
    }
    assert_eq!(fresnel_schlick(Vec3::splat(0.04), 1.0), Vec3::splat(0.04));
    assert_eq!(fresnel_schlick(Vec3::splat(0.04), 0.0), Vec3::ONE);
    let sheet = Dielectric { eta: 1.5, alpha: 0.1, is_thin: true, tint: Vec3::ONE };
    near("sheet", f64::from(reflectance(&sheet, 1.0)), 2.0 * 0.04 / 1.04, 1e-6);
}

fn dielectrics() -> Vec<Dielectric> {
    let mut found = Vec::new();
    for roughness in ROUGHNESSES {
        for (eta, is_thin) in [(1.5, false), (1.0 / 1.5, false), (1.33, true), (2.4, false)] {
            found.push(Dielectric { eta, alpha: roughness * roughness, is_thin, tint: Vec3::ONE });
        }
    }
    found
}

#[test]
fn a_rough_boundary_conserves_energy_and_its_density_stays_below_one() {
    for surface in dielectrics() {
        for cos_o in COSINES {
            let wo = direction(cos_o, 0.2);
            let density = integrate(400, |wi| f64::from(evaluate_dielectric(&surface, wo, wi).pdf_solid_angle));
            assert!(density <= 1.01 && density > 0.4, "{surface:?} {cos_o}: density {density}");
            // Radiance grows with the square of the index on the far side; power does not.
            let squeeze = if surface.is_thin { 1.0 } else { f64::from(surface.eta * surface.eta) };
            let power = integrate(400, |wi| {
                f64::from(evaluate_dielectric(&surface, wo, wi).value.x) * if wi.z < 0.0 { squeeze } else { 1.0 }
            });
            assert!(power <= 1.01, "{surface:?} {cos_o}: power {power}");
            if surface.alpha < 0.2 && cos_o > 0.5 {
                assert!(power > 0.95, "{surface:?} {cos_o}: power {power}");
            }
        }
    }
}

#[test]
fn transmission_is_reciprocal_up_to_the_index_squared() {
    for surface in dielectrics() {
        if surface.is_thin {
            continue;
        }
        let reverse = Dielectric { eta: 1.0 / surface.eta, ..surface };
        for u in points(16) {
            let (wo, wi) = (direction(u.x.max(0.1), 0.3), direction(-u.y.max(0.1), u.z * 6.0));
            let there = evaluate_dielectric(&surface, wo, wi).value.x / wi.z.abs();
            // Seen from the other side the frame is turned over.
            let back = evaluate_dielectric(&reverse, -wi, -wo).value.x / wo.z.abs();
            let expected = there * surface.eta * surface.eta;
            assert!((back - expected).abs() <= 1e-3 * expected.max(0.1), "{surface:?} {wo} {wi}: {back} {expected}");
        }
    }
}

#[test]
fn environment_directions_go_to_the_image_and_back() {
    for u in points(60) {
        let uv = Vec2::new(u.x.clamp(1e-3, 0.999), u.y.clamp(1e-3, 0.999));
        let there = environment_uv(environment_direction(uv));
        assert!(there.abs_diff_eq(uv, 1e-4), "{uv} {there}");
    }
    assert!(environment_direction(Vec2::new(0.5, 0.5)).abs_diff_eq(-Vec3::Z, 1e-6), "the middle looks along -z");
    assert!(environment_direction(Vec2::new(0.75, 0.5)).abs_diff_eq(Vec3::X, 1e-6));
}

#[test]
fn the_environment_density_integrates_to_one() {
    let size = [8, 4];
    let weights: Vec<f32> = (0..32).map(|index| (index % 5) as f32 + 0.5).collect();
    let sum: f32 = weights.iter().sum();
    let probabilities: Vec<f32> = weights.iter().map(|weight| weight / sum).collect();
    let integral = integrate(1024, |w| f64::from(environment_pdf_solid_angle(size, &probabilities, w)));
    near("environment", integral, 1.0, 2e-2);
}

#[test]
fn the_density_of_a_triangle_integrates_to_its_probability() {
    let corners = [Vec3::new(-1.0, -1.0, 2.0), Vec3::new(0.0, 1.5, 2.5), Vec3::new(1.0, -1.0, 2.0)];
    let seen_from = Vec3::new(0.2, 0.1, 0.0);
    // Integrates over directions that meet the triangle.
    let integral = integrate(1000, |w| {
        let normal = (corners[1] - corners[0]).cross(corners[2] - corners[0]);
        let t = (corners[0] - seen_from).dot(normal) / w.dot(normal);
        if !(t > 0.0) {
            return 0.0;
        }
        let point = seen_from + w * t;
        let inside = (0..3).all(|i| (corners[(i + 1) % 3] - corners[i]).cross(point - corners[i]).dot(normal) >= 0.0);
        if inside { f64::from(triangle_pdf_solid_angle(corners, 0.25, seen_from, point)) } else { 0.0 }
    });
    near("triangle", integral, 0.25, 2e-3);
    let behind = triangle_pdf_solid_angle(corners, 1.0, Vec3::new(0.0, 0.0, 5.0), corners[0]);
    assert_eq!(behind, 0.0, "emission leaves the front side only");
}

#[test]
fn a_spot_falls_off_from_its_inner_to_its_outer_cone() {
    let (inner, outer) = (0.3_f32, 0.6_f32);
    let scale = 1.0 / (inner.cos() - outer.cos());
    let offset = -outer.cos() * scale;
    near("axis", f64::from(spot_falloff(1.0, scale, offset)), 1.0, 1e-6);
    near("inner", f64::from(spot_falloff(inner.cos(), scale, offset)), 1.0, 1e-4);
    near("outer", f64::from(spot_falloff(outer.cos(), scale, offset)), 0.0, 1e-4);
    assert_eq!(spot_falloff(-1.0, scale, offset), 0.0);
}
