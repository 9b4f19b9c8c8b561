//! Things that stand in a room. Each stands on y = 0 around the origin and faces +Z.

use std::f32::consts::{PI, TAU};

use glam::{Mat4, Vec3};

use super::shape::Mesh;
use super::texture::hash;
use super::writer::{MaterialId, Object};

/// Materials of the furniture.
#[derive(Clone, Copy, Debug)]
pub(super) struct Palette {
    pub(super) oak: MaterialId,
    pub(super) walnut: MaterialId,
    pub(super) lacquer: MaterialId,
    pub(super) sofa: MaterialId,
    pub(super) armchair: MaterialId,
    pub(super) linen: MaterialId,
    pub(super) steel: MaterialId,
    pub(super) brass: MaterialId,
    pub(super) black_metal: MaterialId,
    pub(super) glass: MaterialId,
    pub(super) ceramic: MaterialId,
    pub(super) glaze: MaterialId,
    pub(super) terracotta: MaterialId,
    pub(super) soil: MaterialId,
    pub(super) leaf: MaterialId,
    pub(super) lamp: MaterialId,
    pub(super) shade: MaterialId,
    pub(super) panel: MaterialId,
    pub(super) screen: MaterialId,
    pub(super) paper: MaterialId,
    pub(super) books: [MaterialId; 6],
    pub(super) fruits: [MaterialId; 3],
}

/// Four legs at the corners of a rectangle.
fn legs(width: f32, depth: f32, height: f32, radius: f32) -> Mesh {
    let mut mesh = Mesh::default();
    for (x, z) in [(-1.0, -1.0), (1.0, -1.0), (-1.0, 1.0), (1.0, 1.0)] {
        mesh.add(Mesh::cylinder(radius, height, 16).at(x * width / 2.0, 0.0, z * depth / 2.0));
    }
    mesh
}

/// A sofa for `seats` people.
pub(super) fn sofa(p: &Palette, seats: u32, cover: MaterialId) -> Object {
    let (seat, arm, depth) = (0.66, 0.18, 0.92);
    let inner = seat * seats as f32;
    let width = inner + 2.0 * arm;
    let mut object = Object::default();
    object.add(p.walnut, legs(width - 0.16, depth - 0.16, 0.12, 0.025));
    object.add(cover, Mesh::pillow(width, 0.2, depth, 0.04, 3).at(0.0, 0.11, 0.0));
    object.add(cover, Mesh::pillow(width - 0.02, 0.66, 0.2, 0.07, 3).at(0.0, 0.16, -depth / 2.0 + 0.11));
    for side in [-1.0, 1.0] {
        object.add(cover, Mesh::pillow(arm, 0.5, depth - 0.02, 0.07, 3).at(side * (width - arm) / 2.0, 0.12, 0.005));
    }
    for k in 0..seats {
        let x = (k as f32 + 0.5) * seat - inner / 2.0;
        object.add(cover, Mesh::pillow(seat - 0.012, 0.17, depth - 0.26, 0.06, 3).at(x, 0.295, 0.1));
        let back = Mesh::pillow(seat - 0.03, 0.42, 0.18, 0.085, 3);
        let tilt = Mat4::from_translation(Vec3::new(x, 0.45, -0.2)) * Mat4::from_rotation_x(-0.2);
        object.add(cover, back.transformed(tilt));
    }
    for (x, turn) in [(-inner / 2.0 + 0.24, 0.35), (inner / 2.0 - 0.26, -0.3)].into_iter().take(seats.min(2) as usize) {
        let cushion = Mesh::pillow(0.42, 0.42, 0.14, 0.068, 3);
        let lean = Mat4::from_translation(Vec3::new(x, 0.462, 0.0))
            * Mat4::from_rotation_y(turn)
            * Mat4::from_rotation_x(-0.42);
        object.add(p.linen, cushion.transformed(lean));
    }
    object
}

/// A low table with a wooden top on metal legs, dressed with books, a bowl and a vase of glass.
pub(super) fn coffee_table(p: &Palette) -> Object {
    let mut object = Object::default();
    object.add(p.walnut, Mesh::pillow(1.15, 0.045, 0.65, 0.015, 3).at(0.0, 0.355, 0.0));
    object.add(p.black_metal, legs(0.98, 0.48, 0.36, 0.016));
    object.add(p.oak, Mesh::pillow(1.0, 0.025, 0.5, 0.01, 1).at(0.0, 0.14, 0.0));
    for (k, (width, depth, turn)) in [(0.3, 0.22, 8.0), (0.26, 0.2, -14.0), (0.22, 0.16, 20.0)].into_iter().enumerate()
    {
        let y = 0.401 + 0.032 * k as f32;
        object.add(p.books[k * 2], Mesh::block(width, 0.0305, depth).turned(turn).at(-0.32, y, 0.05));
    }
    object.add(p.brass, bowl(0.15, 0.07).at(0.34, 0.401, 0.12));
    for (k, fruit) in p.fruits.iter().enumerate() {
        let angle = k as f32 * TAU / 3.0;
        object.add(*fruit, Mesh::ball(0.042, 10).at(0.34 + 0.052 * angle.cos(), 0.455, 0.12 + 0.052 * angle.sin()));
    }
    object.add(p.glass, vase(0.3).at(0.06, 0.401, -0.14));
    object
}

/// A thick-walled vase of height `h`.
pub(super) fn vase(h: f32) -> Mesh {
    let outer = |t: f32| (0.055 + 0.035 * (t * PI * 1.35 + 0.3).sin()) * h / 0.3;
    let mut profile = vec![[0.0, 0.0]];
    profile.extend((0..=20).map(|k| k as f32 / 20.0).map(|t| [outer(t), t * h]));
    profile.extend((0..=18).rev().map(|k| 0.06 + 0.94 * k as f32 / 18.0).map(|t| [outer(t) - 0.009, t * h]));
    profile.push([0.0, 0.06 * h]);
    Mesh::lathe(&profile, 28)
}

/// An open bowl with a wall of 5 mm.
pub(super) fn bowl(radius: f32, height: f32) -> Mesh {
    let curve = |t: f32, r: f32| [0.35 * r + 0.65 * r * (t * PI / 2.0).sin(), t * height];
    let mut profile = vec![[0.0, 0.0]];
    profile.extend((0..=10).map(|k| curve(k as f32 / 10.0, radius)));
    profile.extend((0..=9).rev().map(|k| curve(0.1 + 0.9 * k as f32 / 9.0, radius - 0.005)));
    profile.push([0.0, 0.1 * height]);
    Mesh::lathe(&profile, 26)
}

/// A bookcase with shelves full of books.
pub(super) fn bookcase(p: &Palette, width: f32, height: f32, seed: u32) -> Object {
    let (depth, board) = (0.32, 0.025);
    let shelves = (height / 0.36).floor() as u32;
    let pitch = (height - board) / shelves as f32;
    let mut object = Object::default();
    for side in [-1.0, 1.0] {
        object.add(p.oak, Mesh::block(board, height, depth).at(side * (width - board) / 2.0, 0.0, 0.0));
    }
    let inner = width - 2.0 * board;
    object.add(p.oak, Mesh::block(inner - 0.002, height - 0.02, 0.008).at(0.0, 0.01, -depth / 2.0 + 0.006));
    for shelf in 0..=shelves {
        let y = shelf as f32 * pitch;
        object.add(p.oak, Mesh::block(inner, board, depth - 0.002).at(0.0, y, 0.0));
        if shelf == shelves {
            break;
        }
        let mut x = -inner / 2.0 + 0.01;
        let mut k = 0;
        loop {
            let random = |n: i32| hash(k, shelf as i32 * 16 + n, seed);
            let thick = 0.016 + 0.034 * random(0);
            // gaps hold an ornament now and then
            if random(1) < 0.045 {
                let room = 0.16;
                if x + room < inner / 2.0 {
                    let ornament = if random(2) < 0.5 { vase(0.2) } else { Mesh::ball(0.06, 10).at(0.0, 0.06, 0.0) };
                    let material = if random(3) < 0.5 { p.glaze } else { p.brass };
                    object.add(material, ornament.at(x + room / 2.0, y + board, 0.0));
                }
                x += room;
            } else {
                if x + thick > inner / 2.0 - 0.01 {
                    break;
                }
                let tall = (pitch - board) * (0.62 + 0.3 * random(4));
                let deep = 0.17 + 0.07 * random(5);
                let cover = p.books[(random(6) * 6.0) as usize % 6];
                let (center, front) = (x + thick / 2.0, depth / 2.0 - 0.03 - deep / 2.0 - 0.02 * random(7));
                object.add(cover, Mesh::block(thick - 0.002, tall, deep).at(center, y + board, front));
                let page = Mesh::block(thick - 0.007, tall - 0.008, deep - 0.006).at(
                    center,
                    y + board + 0.004,
                    front - 0.0055,
                );
                object.add(p.paper, page);
                x += thick;
            }
            k += 1;
        }
    }
    object
}

/// A potted plant with arching leaves.
pub(super) fn plant(p: &Palette, height: f32, leaves: u32, seed: u32) -> Object {
    let mut object = Object::default();
    let (r, h) = (0.17, 0.3);
    let pot = [[0.0, 0.0], [r * 0.72, 0.0], [r, h], [r - 0.015, h], [r - 0.03, h - 0.05], [0.0, h - 0.05]];
    object.add(p.terracotta, Mesh::lathe(&pot, 28));
    object.add(p.soil, Mesh::cylinder(r - 0.027, 0.012, 24).at(0.0, h - 0.055, 0.0));
    for k in 0..leaves {
        let random = |n: i32| hash(k as i32, n, seed);
        let turn = k as f32 * 2.399_963 + random(0);
        let long = height * (0.55 + 0.45 * random(1));
        let lean = 0.25 + 0.75 * random(2);
        let broad = 0.05 + 0.035 * random(3);
        let base = h - 0.06;
        let leaf = Mesh::sheet(4, 10, |u, v| {
            let side = (u - 0.5) * 2.0;
            let half = broad * ((v * 0.94 + 0.06) * PI).sin().max(0.02);
            let out = lean * long * v * v * 0.9 + 0.02;
            let up = base + long * (v - 0.42 * lean * v * v * v);
            Vec3::new(side * half, up + 0.25 * half * side.abs(), out)
        });
        object.add(p.leaf, leaf.turned(turn.to_degrees()));
    }
    object
}

/// A standing lamp; its shade is what glows.
pub(super) fn floor_lamp(p: &Palette) -> Object {
    let mut object = Object::default();
    object.add(p.black_metal, Mesh::cylinder(0.15, 0.025, 28));
    object.add(p.brass, Mesh::cylinder(0.011, 1.42, 16).at(0.0, 0.024, 0.0));
    object.add(p.shade, shade(0.13, 0.21, 0.28).at(0.0, 1.32, 0.0));
    object
}

/// A conical shade, open above and below, with a wall of 3 mm.
fn shade(top: f32, bottom: f32, height: f32) -> Mesh {
    let wall = 0.003;
    Mesh::lathe(&[[bottom - wall, 0.0], [bottom, 0.0], [top, height], [top - wall, height], [bottom - wall, 0.0]], 28)
}

/// A lamp for a table, with a glowing shade.
pub(super) fn table_lamp(p: &Palette) -> Object {
    let mut object = Object::default();
    let foot = [[0.0, 0.0], [0.075, 0.0], [0.09, 0.06], [0.07, 0.14], [0.02, 0.2], [0.012, 0.26], [0.0, 0.26]];
    object.add(p.glaze, Mesh::lathe(&foot, 26));
    object.add(p.brass, Mesh::cylinder(0.008, 0.07, 12).at(0.0, 0.255, 0.0));
    object.add(p.shade, shade(0.1, 0.17, 0.2).at(0.0, 0.27, 0.0));
    object
}

/// A lamp on a cord: the ceiling is at `drop` above its lower rim.
pub(super) fn pendant(p: &Palette, drop: f32) -> Object {
    let mut object = Object::default();
    let bell: Vec<[f32; 2]> =
        (0..=12).map(|k| k as f32 / 12.0 * PI / 2.0).map(|a| [0.17 * a.cos().max(0.08), 0.2 * a.sin()]).collect();
    // up the outside, down the inside, and closed at the rim
    let mut outline = bell.clone();
    outline.extend(bell.iter().rev().map(|q| [q[0] - 0.003, q[1] - 0.003]));
    outline.push(bell[0]);
    object.add(p.brass, Mesh::lathe(&outline, 28));
    object.add(p.black_metal, Mesh::cylinder(0.004, drop - 0.19, 8).at(0.0, 0.195, 0.0));
    // a diffuser that closes the bell and shines down
    object.add(p.lamp, Mesh::lathe(&[[0.0, 0.0], [0.135, 0.0]], 28).at(0.0, 0.05, 0.0));
    object
}

/// A framed picture on a wall; its back is at z = 0.
pub(super) fn picture(p: &Palette, canvas: MaterialId, width: f32, height: f32) -> Object {
    let (frame, thick) = (0.035, 0.025);
    let mut object = Object::default();
    for y in [0.0, height - frame] {
        object.add(p.walnut, Mesh::block(width, frame, thick).at(0.0, y, thick / 2.0));
    }
    for side in [-1.0, 1.0] {
        let bar = Mesh::block(frame, height - 2.0 * frame, thick);
        object.add(p.walnut, bar.at(side * (width - frame) / 2.0, frame, thick / 2.0));
    }
    let (w, h) = (width - 2.0 * frame, height - 2.0 * frame);
    let origin = Vec3::new(-w / 2.0, frame, thick * 0.6);
    let mut sheet = Mesh::rectangle(origin, Vec3::X * w, Vec3::Y * h);
    // the whole picture once, its first row on top
    for (uv, corner) in sheet.uvs.iter_mut().zip([[0.0, 1.0], [1.0, 1.0], [1.0, 0.0], [0.0, 0.0]]) {
        *uv = corner.into();
    }
    object.add(canvas, sheet);
    object
}

/// A chair with a woven seat.
pub(super) fn chair(p: &Palette) -> Object {
    let mut object = Object::default();
    object.add(p.linen, Mesh::pillow(0.44, 0.05, 0.43, 0.022, 3).at(0.0, 0.43, 0.0));
    for x in [-0.19, 0.19] {
        let front = [Vec3::new(x, 0.0, 0.19), Vec3::new(x, 0.44, 0.18)];
        object.add(p.oak, Mesh::tube(&front, 0.017, 12));
        let back: Vec<Vec3> = (0..=8)
            .map(|k| k as f32 / 8.0)
            .map(|t| Vec3::new(x, t * 0.86, -0.2 - 0.09 * (t - 0.5).max(0.0) * 2.0 - 0.03 * (1.0 - t)))
            .collect();
        object.add(p.oak, Mesh::tube(&back, 0.017, 12));
        object.add(p.oak, Mesh::tube(&[Vec3::new(x, 0.2, 0.185), Vec3::new(x, 0.2, -0.215)], 0.011, 10));
    }
    for y in [0.62, 0.79] {
        let bow: Vec<Vec3> = (0..=10)
            .map(|k| k as f32 / 5.0 - 1.0)
            .map(|t| Vec3::new(t * 0.19, y, -0.225 - 0.04 * (1.0 - t * t) - (y - 0.43) * 0.12))
            .collect();
        object.add(p.oak, Mesh::tube(&bow, 0.022, 12));
    }
    object
}

/// A sideboard with sliding doors, on legs.
pub(super) fn sideboard(p: &Palette, width: f32) -> Object {
    let (height, depth) = (0.52, 0.42);
    let mut object = Object::default();
    object.add(p.black_metal, legs(width - 0.2, depth - 0.14, 0.17, 0.014));
    object.add(p.walnut, Mesh::pillow(width, height, depth, 0.012, 1).at(0.0, 0.165, 0.0));
    let doors = 3;
    let door = (width - 0.05) / doors as f32;
    for k in 0..doors {
        let x = (k as f32 + 0.5) * door - (width - 0.05) / 2.0;
        object.add(
            p.lacquer,
            Mesh::pillow(door - 0.012, height - 0.06, 0.018, 0.005, 1).at(x, 0.195, depth / 2.0 + 0.006),
        );
        object.add(p.brass, Mesh::ball(0.013, 10).at(x + door / 2.0 - 0.06, 0.44, depth / 2.0 + 0.026));
    }
    object
}

/// A curtain hanging in folds from `height` to just above the floor, `width` wide, in the plane z = 0.
pub(super) fn curtain(p: &Palette, width: f32, height: f32, folds: f32) -> Object {
    let mut object = Object::default();
    let cloth = Mesh::sheet((folds * 16.0) as u32, 12, |u, v| {
        let depth = 0.035 + 0.015 * (1.0 - v);
        let wave = (u * folds * TAU).sin() * depth + (u * folds * 2.3 * TAU + v * 3.0).sin() * 0.006;
        Vec3::new((u - 0.5) * width, 0.02 + v * (height - 0.02), wave)
    });
    object.add(p.linen, cloth);
    object
}

/// A desk with drawers, a screen, a lamp and paper.
pub(super) fn desk(p: &Palette) -> Object {
    let mut object = Object::default();
    object.add(p.oak, Mesh::pillow(1.6, 0.035, 0.7, 0.01, 1).at(0.0, 0.715, 0.0));
    object.add(p.black_metal, legs(1.46, 0.56, 0.72, 0.02));
    object.add(p.lacquer, Mesh::pillow(0.42, 0.4, 0.58, 0.008, 1).at(0.55, 0.312, 0.0));
    for k in 0..3 {
        let y = 0.33 + 0.128 * k as f32;
        object.add(p.oak, Mesh::pillow(0.39, 0.118, 0.016, 0.004, 1).at(0.55, y, 0.296));
        object.add(p.brass, Mesh::ball(0.011, 10).at(0.55, y + 0.06, 0.312));
    }
    object.add(p.black_metal, Mesh::cylinder(0.11, 0.012, 24).at(-0.1, 0.75, -0.12));
    object.add(p.black_metal, Mesh::block(0.03, 0.2, 0.012).at(-0.1, 0.755, -0.14));
    object.add(p.black_metal, Mesh::pillow(0.62, 0.37, 0.024, 0.008, 1).at(-0.1, 0.88, -0.12));
    let origin = Vec3::new(-0.4, 0.892, -0.107);
    object.add(p.screen, Mesh::rectangle(origin, Vec3::X * 0.6, Vec3::Y * 0.345));
    object.add(p.black_metal, Mesh::pillow(0.42, 0.018, 0.14, 0.006, 1).at(-0.1, 0.75, 0.16));
    object.add(p.paper, Mesh::block(0.21, 0.006, 0.297).turned(12.0).at(0.38, 0.75, 0.1));
    object.add(p.ceramic, mug().at(0.26, 0.75, -0.1));
    object
}

/// A mug with a handle.
pub(super) fn mug() -> Mesh {
    let (r, h) = (0.042, 0.095);
    let mut mesh = Mesh::lathe(
        &[[0.0, 0.0], [r * 0.9, 0.0], [r, 0.01], [r, h], [r - 0.004, h], [r - 0.004, 0.008], [0.0, 0.006]],
        24,
    );
    let handle: Vec<Vec3> = (0..=12)
        .map(|k| (k as f32 / 12.0 - 0.5) * PI)
        .map(|a| Vec3::new(r - 0.004 + 0.03 * a.cos(), h / 2.0 + 0.032 * a.sin(), 0.0))
        .collect();
    mesh.add(Mesh::tube(&handle, 0.0055, 10));
    mesh
}

/// A bed for one, against a wall at its back.
pub(super) fn daybed(p: &Palette) -> Object {
    let mut object = Object::default();
    object.add(p.walnut, legs(1.86, 0.78, 0.16, 0.024));
    object.add(p.oak, Mesh::pillow(2.0, 0.14, 0.92, 0.015, 1).at(0.0, 0.155, 0.0));
    object.add(p.linen, Mesh::pillow(1.94, 0.2, 0.88, 0.07, 3).at(0.0, 0.29, 0.0));
    object.add(p.armchair, Mesh::pillow(1.2, 0.05, 0.91, 0.024, 3).at(-0.3, 0.475, 0.0));
    for (x, turn) in [(0.68, 0.1), (0.4, -0.25)] {
        let lean = Mat4::from_translation(Vec3::new(x, 0.487, -0.2))
            * Mat4::from_rotation_y(turn)
            * Mat4::from_rotation_x(-0.35);
        object.add(p.sofa, Mesh::pillow(0.46, 0.4, 0.15, 0.07, 3).transformed(lean));
    }
    object
}
