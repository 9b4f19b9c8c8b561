//! Kitchen and dining table.

use std::f32::consts::PI;

use glam::Vec3;

use super::furniture::{Palette, bowl};
use super::shape::Mesh;
use super::writer::{MaterialId, Object};

/// Materials only the kitchen has.
#[derive(Clone, Copy, Debug)]
pub(super) struct Surfaces {
    pub(super) marble: MaterialId,
    pub(super) wall_tiles: MaterialId,
}

const DEPTH: f32 = 0.6;

/// A row of base units `width` wide along a wall at z = 0, with worktop, sink, hob and backsplash. Starts at x = 0.
pub(super) fn counter(p: &Palette, s: &Surfaces, width: f32) -> Object {
    let mut object = Object::default();
    let units = (width / 0.6).round() as u32;
    let unit = width / units as f32;
    object.add(p.black_metal, Mesh::block(width - 0.04, 0.1, DEPTH - 0.09).at(width / 2.0, 0.0, DEPTH / 2.0 - 0.04));
    object.add(p.lacquer, Mesh::block(width, 0.775, DEPTH - 0.02).at(width / 2.0, 0.099, DEPTH / 2.0 - 0.005));
    for k in 0..units {
        let x = (k as f32 + 0.5) * unit;
        let z = DEPTH - 0.006;
        if k % 2 == 0 {
            for (y, height) in [(0.11, 0.36), (0.475, 0.185), (0.665, 0.195)] {
                object.add(p.lacquer, Mesh::pillow(unit - 0.008, height - 0.006, 0.02, 0.004, 1).at(x, y, z));
                object.add(p.brass, Mesh::pillow(0.16, 0.012, 0.018, 0.005, 1).at(x, y + height - 0.05, z + 0.018));
            }
        } else {
            object.add(p.lacquer, Mesh::pillow(unit - 0.008, 0.744, 0.02, 0.004, 1).at(x, 0.11, z));
            object.add(p.brass, Mesh::pillow(0.012, 0.16, 0.018, 0.005, 1).at(x + unit / 2.0 - 0.06, 0.62, z + 0.018));
        }
    }
    object.add(
        s.marble,
        Mesh::pillow(width + 0.01, 0.036, DEPTH + 0.045, 0.008, 1).at(width / 2.0, 0.873, DEPTH / 2.0 + 0.026),
    );
    object.add(s.wall_tiles, Mesh::block(width, 0.54, 0.012).at(width / 2.0, 0.908, 0.0065));
    let sink = unit * 1.5;
    object.add(p.steel, basin(0.5, 0.36).at(sink, 0.9085, 0.33));
    object.add(p.steel, faucet().at(sink, 0.9085, 0.09));
    let hob = width - unit * 1.5;
    object.add(p.black_metal, Mesh::pillow(0.56, 0.01, 0.48, 0.004, 1).at(hob, 0.9085, 0.31));
    for (x, z, r) in [(-0.14, 0.2, 0.08), (0.14, 0.2, 0.1), (-0.14, 0.43, 0.1), (0.14, 0.43, 0.07)] {
        object.add(p.steel, Mesh::cylinder(r, 0.004, 24).at(hob + x, 0.918, z));
    }
    object.add(p.steel, pot(0.1, 0.13).at(hob + 0.14, 0.9215, 0.2));
    object.add(p.ceramic, bowl(0.12, 0.08).at(unit * 2.6, 0.9085, 0.3));
    for (k, fruit) in p.fruits.iter().enumerate() {
        let angle = k as f32 * 2.1;
        let (x, z) = (unit * 2.6 + 0.04 * angle.cos(), 0.3 + 0.04 * angle.sin());
        object.add(*fruit, Mesh::ball(0.036, 8).at(x, 0.966, z));
    }
    object.add(p.oak, Mesh::pillow(0.3, 0.02, 0.2, 0.006, 1).turned(7.0).at(unit * 3.3, 0.9085, 0.36));
    object
}

/// A shallow basin with a rim, let into the worktop only in looks: it stands 2 cm proud, as a mounted sink does.
fn basin(width: f32, depth: f32) -> Mesh {
    let (rim, height) = (0.018, 0.02);
    let mut mesh = Mesh::pillow(width, 0.004, depth, 0.0018, 1);
    for z in [-1.0, 1.0] {
        mesh.add(Mesh::pillow(width, height, rim, 0.006, 1).at(0.0, 0.0, z * (depth - rim) / 2.0));
    }
    for x in [-1.0, 1.0] {
        mesh.add(Mesh::pillow(rim, height, depth - 2.0 * rim, 0.006, 1).at(x * (width - rim) / 2.0, 0.0, 0.0));
    }
    mesh
}

fn faucet() -> Mesh {
    let mut path = vec![Vec3::ZERO, Vec3::Y * 0.26];
    path.extend(
        (1..=12).map(|k| k as f32 / 12.0 * PI).map(|a| Vec3::new(0.0, 0.26 + 0.09 * a.sin(), 0.09 * (1.0 - a.cos()))),
    );
    path.push(Vec3::new(0.0, 0.2, 0.18));
    let mut mesh = Mesh::tube(&path, 0.013, 16);
    mesh.add(Mesh::cylinder(0.026, 0.03, 24));
    mesh.add(Mesh::tube(&[Vec3::new(0.01, 0.06, 0.0), Vec3::new(0.075, 0.09, 0.0)], 0.007, 12));
    mesh
}

fn pot(radius: f32, height: f32) -> Mesh {
    let wall = 0.004;
    let mut mesh = Mesh::lathe(
        &[[0.0, 0.0], [radius, 0.0], [radius, height], [radius - wall, height], [radius - wall, wall], [0.0, wall]],
        28,
    );
    for side in [-1.0, 1.0] {
        let grip: Vec<Vec3> = (0..=8)
            .map(|k| (k as f32 / 8.0 - 0.5) * PI)
            .map(|a| Vec3::new(side * (radius - 0.003 + 0.03 * a.cos()), height * 0.8, 0.035 * a.sin()))
            .collect();
        mesh.add(Mesh::tube(&grip, 0.005, 8));
    }
    mesh
}

/// Wall units above the counter, with a hood in their middle. Starts at x = 0, hangs with its back at z = 0.
pub(super) fn wall_units(p: &Palette, width: f32) -> Object {
    let (low, height, depth) = (1.46, 0.7, 0.34);
    let units = (width / 0.6).round() as u32;
    let unit = width / units as f32;
    let mut object = Object::default();
    // a strip of light under the units, facing down
    let strip = unit * (units - 2) as f32;
    object.add(p.panel, Mesh::rectangle(Vec3::new(0.05, low - 0.002, 0.12), Vec3::X * (strip - 0.1), Vec3::Z * 0.03));
    for k in 0..units {
        let x = (k as f32 + 0.5) * unit;
        if k + 2 == units {
            object.add(p.steel, Mesh::pillow(unit - 0.02, 0.07, 0.48, 0.006, 1).at(x, low + 0.12, 0.245));
            object.add(p.steel, Mesh::block(0.26, 0.98, 0.26).at(x, low + 0.185, 0.14));
            continue;
        }
        object.add(p.lacquer, Mesh::block(unit - 0.002, height, depth).at(x, low, depth / 2.0 + 0.004));
        object
            .add(p.lacquer, Mesh::pillow(unit - 0.01, height - 0.01, 0.02, 0.004, 1).at(x, low + 0.005, depth + 0.013));
        object.add(
            p.brass,
            Mesh::pillow(0.012, 0.14, 0.018, 0.005, 1).at(x + unit / 2.0 - 0.06, low + 0.05, depth + 0.03),
        );
    }
    object
}

/// A tall refrigerator, its back at z = 0.
pub(super) fn refrigerator(p: &Palette) -> Object {
    let mut object = Object::default();
    object.add(p.black_metal, Mesh::block(0.6, 0.06, 0.56).at(0.0, 0.0, 0.31));
    object.add(p.steel, Mesh::pillow(0.66, 1.94, 0.6, 0.012, 1).at(0.0, 0.055, 0.31));
    for (y, height) in [(0.07, 0.66), (0.745, 1.24)] {
        object.add(p.steel, Mesh::pillow(0.65, height, 0.05, 0.014, 3).at(0.0, y, 0.636));
    }
    for (low, high) in [(0.45, 0.68), (0.8, 1.35)] {
        let bar = [Vec3::new(-0.27, low, 0.7), Vec3::new(-0.27, high, 0.7)];
        object.add(p.black_metal, Mesh::tube(&bar, 0.011, 12));
        for y in [low + 0.03, high - 0.03] {
            object.add(p.black_metal, Mesh::tube(&[Vec3::new(-0.27, y, 0.655), Vec3::new(-0.27, y, 0.7)], 0.008, 10));
        }
    }
    object
}

/// A dining table laid for six.
pub(super) fn dining_table(p: &Palette) -> Object {
    let top = 0.75;
    let mut object = Object::default();
    object.add(p.oak, Mesh::pillow(1.9, 0.04, 0.95, 0.014, 3).at(0.0, top - 0.04, 0.0));
    for x in [-0.72, 0.72] {
        object.add(p.oak, Mesh::pillow(0.1, top - 0.045, 0.1, 0.02, 3).at(x, 0.0, -0.3));
        object.add(p.oak, Mesh::pillow(0.1, top - 0.045, 0.1, 0.02, 3).at(x, 0.0, 0.3));
        object.add(p.oak, Mesh::block(0.06, 0.08, 0.5).at(x, top - 0.125, 0.0));
    }
    object.add(p.oak, Mesh::block(1.34, 0.08, 0.06).at(0.0, top - 0.126, 0.0));
    for (x, z) in [(-0.6, -0.28), (0.0, -0.28), (0.6, -0.28), (-0.6, 0.28), (0.0, 0.28), (0.6, 0.28)] {
        let plate = [[0.0, 0.0], [0.075, 0.0], [0.13, 0.018], [0.128, 0.022], [0.07, 0.006], [0.0, 0.006]];
        object.add(p.ceramic, Mesh::lathe(&plate, 26).at(x, top + 0.0005, z));
        object.add(p.glass, tumbler().at(x + 0.17, top + 0.0005, z * 0.55));
        object.add(p.steel, Mesh::pillow(0.012, 0.004, 0.19, 0.0018, 1).at(x + 0.155, top + 0.0005, z));
        object.add(p.steel, Mesh::pillow(0.016, 0.004, 0.18, 0.0018, 1).at(x - 0.155, top + 0.0005, z));
    }
    object.add(p.glaze, bowl(0.17, 0.09).at(0.0, top + 0.0005, 0.0));
    for k in 0..6 {
        let angle = k as f32 / 6.0 * 2.0 * PI;
        let fruit = p.fruits[k % 3];
        object.add(fruit, Mesh::ball(0.041, 10).at(0.085 * angle.cos(), top + 0.075, 0.085 * angle.sin()));
    }
    object
}

/// A thick-walled drinking glass.
fn tumbler() -> Mesh {
    Mesh::lathe(&[[0.0, 0.0], [0.03, 0.0], [0.036, 0.1], [0.0335, 0.1], [0.0275, 0.012], [0.0, 0.012]], 24)
}
