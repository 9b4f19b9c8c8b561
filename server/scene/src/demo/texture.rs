//! Procedural pictures as PNG files. Every one tiles.

use std::io::Cursor;

use glam::{Vec2, Vec3};
use image::{ImageFormat, Rgb, RgbImage};

/// A deterministic number in [0, 1) for a lattice point.
pub(super) fn hash(x: i32, y: i32, seed: u32) -> f32 {
    let mut h =
        (x as u32).wrapping_mul(0x8da6_b343) ^ (y as u32).wrapping_mul(0xd816_3841) ^ seed.wrapping_mul(0xcb1a_b31f);
    h = (h ^ (h >> 15)).wrapping_mul(0x2c1b_3c6d);
    h = (h ^ (h >> 12)).wrapping_mul(0x297a_2d39);
    (h ^ (h >> 15)) as f32 / 4_294_967_296.0
}

/// Smooth noise in [0, 1) with the given periods.
fn noise(p: Vec2, periods: [i32; 2], seed: u32) -> f32 {
    let cell = p.floor();
    let f = p - cell;
    let f = f * f * (Vec2::splat(3.0) - 2.0 * f);
    let at = |dx: i32, dy: i32| {
        let (x, y) = (cell.x as i32 + dx, cell.y as i32 + dy);
        hash(x.rem_euclid(periods[0]), y.rem_euclid(periods[1]), seed)
    };
    let low = at(0, 0) + (at(1, 0) - at(0, 0)) * f.x;
    let high = at(0, 1) + (at(1, 1) - at(0, 1)) * f.x;
    low + (high - low) * f.y
}

/// A picture from a function of (u, v) in the unit square to sRGB in [0, 1], in 32 levels a channel so that it packs
/// well.
fn paint(width: u32, height: u32, color: impl Fn(f32, f32) -> Vec3) -> Vec<u8> {
    let picture = RgbImage::from_fn(width, height, |x, y| {
        let c = color((x as f32 + 0.5) / width as f32, (y as f32 + 0.5) / height as f32);
        Rgb(c.to_array().map(|c| ((c.clamp(0.0, 1.0) * 31.0).round() * (255.0 / 31.0)) as u8))
    });
    let mut out = Cursor::new(Vec::new());
    // writing to memory fails for no picture of this kind; an empty file would be refused by the loader's tests
    let _ = picture.write_to(&mut out, ImageFormat::Png);
    out.into_inner()
}

/// Wood grain along v, `planks` boards side by side across u.
pub(super) fn wood(dark: Vec3, light: Vec3, planks: i32, seed: u32) -> Vec<u8> {
    paint(256, 512, |u, v| {
        let board = (u * planks as f32).floor() as i32;
        let across = (u * planks as f32).fract();
        let shift = hash(board, 0, seed);
        let rings = noise(Vec2::new(across * 6.0 + shift * 32.0, v * 4.0), [64, 4], seed);
        let fibre = noise(Vec2::new(u * 128.0, v * 8.0), [128, 8], seed + 1);
        let tone = (((rings * 9.0 + shift * 3.0).fract() - 0.5).abs() * 1.2 + fibre * 0.3 + (shift - 0.5) * 0.5)
            .clamp(0.0, 1.0);
        // two joints a board, staggered
        let joint = ((v * 2.0 + shift).fract() - 0.5).abs() > 0.496;
        let gap = planks > 1 && (!(0.02..=0.98).contains(&across) || joint);
        dark.lerp(light, tone) * if gap { 0.45 } else { 1.0 }
    })
}

/// Square tiles with grout, four to a side.
pub(super) fn tiles(tile: Vec3, grout: Vec3, seed: u32) -> Vec<u8> {
    paint(256, 256, |u, v| {
        let (x, y) = (u * 4.0, v * 4.0);
        let edge = (x.fract() - 0.5).abs().max((y.fract() - 0.5).abs());
        let shade = 0.92 + 0.08 * hash(x as i32, y as i32, seed);
        if edge > 0.475 { grout } else { tile * shade }
    })
}

/// A plain weave.
pub(super) fn fabric(a: Vec3, b: Vec3, seed: u32) -> Vec<u8> {
    paint(256, 256, |u, v| {
        let (x, y) = ((u * 64.0) as i32, (v * 64.0) as i32);
        let over = (x + y) % 2 == 0;
        let thread = if over { (u * 64.0).fract() } else { (v * 64.0).fract() };
        let bulge = 0.78 + 0.22 * (thread * std::f32::consts::PI).sin();
        let wear = noise(Vec2::new(u * 8.0, v * 8.0), [8, 8], seed);
        (if over { a } else { b }) * bulge * (0.9 + 0.2 * wear)
    })
}

/// Painted plaster: nearly even.
pub(super) fn plaster(color: Vec3, seed: u32) -> Vec<u8> {
    paint(128, 128, |u, v| {
        let coarse = noise(Vec2::new(u * 8.0, v * 8.0), [8, 8], seed);
        let fine = noise(Vec2::new(u * 64.0, v * 64.0), [64, 64], seed + 1);
        color * (0.94 + 0.04 * coarse + 0.03 * fine)
    })
}

/// Stone with veins.
pub(super) fn marble(base: Vec3, vein: Vec3, seed: u32) -> Vec<u8> {
    paint(256, 256, |u, v| {
        let p = Vec2::new(u, v);
        let bend = noise(p * 4.0, [4, 4], seed)
            + 0.5 * noise(p * 8.0, [8, 8], seed + 1)
            + 0.25 * noise(p * 16.0, [16, 16], seed + 2);
        let line = 1.0 - (((u + v + bend * 0.8).fract() - 0.5).abs() * 2.0);
        base.lerp(vein, line.powi(12) * 0.7)
    })
}

/// A rug with borders and lozenges over the whole picture.
pub(super) fn rug(ground: Vec3, pattern: Vec3, border: Vec3) -> Vec<u8> {
    paint(256, 256, |u, v| {
        let edge = (u - 0.5).abs().max((v - 0.5).abs());
        let (x, y) = (((u * 6.0).fract() - 0.5).abs(), ((v * 6.0).fract() - 0.5).abs());
        let knot = 0.88 + 0.12 * hash((u * 128.0) as i32, (v * 128.0) as i32, 3);
        let color = if edge > 0.47 || (0.41..0.43).contains(&edge) {
            border
        } else if edge > 0.43 {
            ground
        } else if (x + y - 0.32).abs() < 0.05 || x + y < 0.1 {
            pattern
        } else {
            ground
        };
        color * knot
    })
}

/// A painting: hills under a sky, different for every seed.
pub(super) fn painting(sky: [Vec3; 2], hills: [Vec3; 2], seed: u32) -> Vec<u8> {
    paint(192, 128, |u, v| {
        let mut color = sky[0].lerp(sky[1], v);
        let sun = Vec2::new((u - 0.3 - 0.4 * hash(0, 0, seed)) * 1.5, v - 0.28);
        if sun.length() < 0.09 {
            color = Vec3::new(1.0, 0.93, 0.75);
        }
        for layer in 0..4 {
            let depth = layer as f32 / 3.0;
            let height = 0.45 + 0.13 * layer as f32;
            let ridge = noise(Vec2::new(u * (3.0 + layer as f32), 0.5 + layer as f32), [64, 64], seed) * 0.25;
            if v > height - ridge + 0.05 {
                let brush = 0.9 + 0.2 * noise(Vec2::new(u * 40.0, v * 90.0), [64, 128], seed + 7);
                color = hills[0].lerp(hills[1], depth) * brush;
            }
        }
        color
    })
}
