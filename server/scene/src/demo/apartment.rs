//! An apartment on a sunny afternoon: living room, kitchen with dining table, study.
//!
//! Metres, +Y up. The living room spans x 0..6, z 0..5, the kitchen x 6.15..10, z 0..5, the study x 0..4.5, z
//! -3.5..-0.15; ceilings are at 2.7. South, where the large windows are, is +Z. Walls reach a little into each other,
//! into floor and ceiling, so that no two faces lie in one plane and no seam lets light through.

use glam::{Vec2, Vec3};
use serde_json::{Value, json};

use super::furniture::{self as f, Palette};
use super::kitchen::{self, Surfaces};
use super::shape::{Mesh, Opening, wall};
use super::texture;
use super::writer::{MaterialId, Object, Writer};

const CEILING: f32 = 2.7;
/// Walls stand this much in the floor and the ceiling.
const SUNK: f32 = 0.05;

/// The apartment as GLB.
pub fn interior() -> Vec<u8> {
    let mut writer = Writer::new();
    let shell = Shell::new(&mut writer);
    let (palette, surfaces) = palette(&mut writer);
    build_shell(&mut writer, &shell, &palette);
    living_room(&mut writer, &palette, &shell);
    kitchen_room(&mut writer, &palette, &surfaces, &shell);
    study(&mut writer, &palette, &shell);
    writer.sun(Vec3::new(-0.48, -0.62, -0.72), [1.0, 0.9, 0.75], 14.0);
    writer.finish()
}

/// View file of the apartment.
pub(super) fn view() -> String {
    let camera = |name: &str, position: [f64; 3], target: [f64; 3], vfov: f64| {
        json!({"name": name, "position": position, "target": target, "up": [0, 1, 0], "vfov_deg": vfov,
               "resolution": [960, 540]})
    };
    json!({"cameras": [
        camera("living room", [5.6, 1.55, 4.55], [1.6, 0.85, 1.3], 58.0),
        camera("dining", [5.1, 1.6, 3.4], [8.9, 0.95, 1.5], 56.0),
        camera("kitchen", [9.7, 1.6, 4.7], [7.3, 0.9, 0.9], 60.0),
        camera("study", [4.2, 1.6, -0.45], [0.6, 0.8, -2.4], 62.0),
        camera("still life", [2.75, 0.82, 2.65], [1.68, 0.47, 1.72], 34.0)],
        "environment": {"type": "constant", "radiance": [1.1, 1.45, 2.0]}, "exposure": 2.2})
    .to_string()
}

/// Materials of walls, floors and what hangs on them.
struct Shell {
    plaster: MaterialId,
    accent: MaterialId,
    ceiling: MaterialId,
    boards: MaterialId,
    floor_tiles: MaterialId,
    paint: MaterialId,
    rug: MaterialId,
    study_rug: MaterialId,
    grass: MaterialId,
    foliage: MaterialId,
    bark: MaterialId,
    paintings: [MaterialId; 4],
}

fn rgb(r: f32, g: f32, b: f32) -> Vec3 {
    Vec3::new(r, g, b)
}

fn matte(name: &str, color: [f32; 3], roughness: f32, metallic: f32) -> Value {
    let [r, g, b] = color;
    json!({"name": name, "pbrMetallicRoughness":
        {"baseColorFactor": [r, g, b, 1.0], "roughnessFactor": roughness, "metallicFactor": metallic}})
}

fn textured(writer: &mut Writer, name: &str, png: &[u8], roughness: f32, repeat: f32) -> MaterialId {
    let texture = writer.texture(png);
    let json = json!({"name": name, "pbrMetallicRoughness":
        {"baseColorTexture": {"index": texture}, "roughnessFactor": roughness, "metallicFactor": 0.0}});
    writer.textured(json, repeat)
}

impl Shell {
    fn new(writer: &mut Writer) -> Self {
        let painting = |writer: &mut Writer, seed, sky: [Vec3; 2], hills: [Vec3; 2]| {
            let png = texture::painting(sky, hills, seed);
            textured(writer, "painting", &png, 0.7, 1.0)
        };
        Self {
            plaster: textured(writer, "plaster", &texture::plaster(rgb(0.93, 0.91, 0.87), 1), 0.9, 0.5),
            accent: textured(writer, "sage plaster", &texture::plaster(rgb(0.62, 0.69, 0.62), 2), 0.9, 0.5),
            ceiling: writer.material(matte("ceiling", [0.86, 0.86, 0.85], 0.95, 0.0)),
            boards: textured(
                writer,
                "floor boards",
                &texture::wood(rgb(0.42, 0.28, 0.17), rgb(0.68, 0.5, 0.34), 5, 11),
                0.42,
                0.8,
            ),
            floor_tiles: textured(
                writer,
                "floor tiles",
                &texture::tiles(rgb(0.72, 0.7, 0.68), rgb(0.45, 0.44, 0.43), 5),
                0.3,
                0.6,
            ),
            paint: writer.material(matte("white paint", [0.85, 0.85, 0.83], 0.45, 0.0)),
            rug: textured(
                writer,
                "rug",
                &texture::rug(rgb(0.62, 0.16, 0.13), rgb(0.93, 0.83, 0.63), rgb(0.14, 0.19, 0.34)),
                1.0,
                1.0,
            ),
            study_rug: textured(
                writer,
                "study rug",
                &texture::rug(rgb(0.2, 0.31, 0.42), rgb(0.85, 0.82, 0.74), rgb(0.72, 0.5, 0.2)),
                1.0,
                1.0,
            ),
            grass: writer.material(matte("lawn", [0.14, 0.24, 0.07], 1.0, 0.0)),
            foliage: writer.material(matte("foliage", [0.1, 0.22, 0.06], 1.0, 0.0)),
            bark: writer.material(matte("bark", [0.2, 0.13, 0.08], 1.0, 0.0)),
            paintings: [
                painting(
                    writer,
                    3,
                    [rgb(0.95, 0.7, 0.45), rgb(0.98, 0.88, 0.7)],
                    [rgb(0.55, 0.4, 0.5), rgb(0.15, 0.2, 0.3)],
                ),
                painting(
                    writer,
                    8,
                    [rgb(0.45, 0.65, 0.85), rgb(0.9, 0.93, 0.95)],
                    [rgb(0.5, 0.65, 0.55), rgb(0.12, 0.28, 0.16)],
                ),
                painting(
                    writer,
                    21,
                    [rgb(0.2, 0.22, 0.4), rgb(0.85, 0.5, 0.4)],
                    [rgb(0.35, 0.2, 0.35), rgb(0.08, 0.06, 0.14)],
                ),
                painting(
                    writer,
                    34,
                    [rgb(0.8, 0.85, 0.8), rgb(0.96, 0.94, 0.88)],
                    [rgb(0.75, 0.7, 0.5), rgb(0.4, 0.25, 0.15)],
                ),
            ],
        }
    }
}

fn palette(writer: &mut Writer) -> (Palette, Surfaces) {
    let lamp = |name: &str, color: [f32; 3], strength: f32| {
        json!({"name": name, "emissiveFactor": color,
            "pbrMetallicRoughness": {"baseColorFactor": [0.0, 0.0, 0.0, 1.0], "metallicFactor": 0.0},
            "extensions": {"KHR_materials_emissive_strength": {"emissiveStrength": strength}}})
    };
    let oak = textured(writer, "oak", &texture::wood(rgb(0.55, 0.38, 0.22), rgb(0.8, 0.62, 0.42), 1, 5), 0.5, 1.6);
    let walnut =
        textured(writer, "walnut", &texture::wood(rgb(0.2, 0.12, 0.07), rgb(0.42, 0.27, 0.17), 1, 9), 0.4, 1.6);
    let sofa =
        textured(writer, "sofa cloth", &texture::fabric(rgb(0.25, 0.36, 0.44), rgb(0.32, 0.44, 0.52), 2), 0.95, 4.0);
    let armchair =
        textured(writer, "mustard cloth", &texture::fabric(rgb(0.72, 0.5, 0.16), rgb(0.8, 0.6, 0.25), 4), 0.95, 4.0);
    let linen = textured(writer, "linen", &texture::fabric(rgb(0.86, 0.82, 0.74), rgb(0.92, 0.89, 0.83), 6), 0.95, 4.0);
    let surfaces = Surfaces {
        marble: textured(writer, "marble", &texture::marble(rgb(0.93, 0.92, 0.9), rgb(0.45, 0.46, 0.5), 3), 0.15, 1.0),
        wall_tiles: textured(
            writer,
            "wall tiles",
            &texture::tiles(rgb(0.55, 0.72, 0.72), rgb(0.85, 0.85, 0.83), 8),
            0.12,
            1.8,
        ),
    };
    let mut plain = |name: &str, color: [f32; 3], roughness: f32, metallic: f32| {
        writer.material(matte(name, color, roughness, metallic))
    };
    let books = [
        plain("red book", [0.42, 0.06, 0.05], 0.6, 0.0),
        plain("blue book", [0.06, 0.12, 0.3], 0.6, 0.0),
        plain("green book", [0.07, 0.2, 0.12], 0.6, 0.0),
        plain("ochre book", [0.55, 0.35, 0.1], 0.6, 0.0),
        plain("cream book", [0.72, 0.66, 0.52], 0.6, 0.0),
        plain("grey book", [0.15, 0.15, 0.17], 0.6, 0.0),
    ];
    let fruits = [
        plain("orange", [0.85, 0.35, 0.04], 0.45, 0.0),
        plain("apple", [0.55, 0.05, 0.04], 0.2, 0.0),
        plain("pear", [0.5, 0.55, 0.1], 0.4, 0.0),
    ];
    let palette = Palette {
        oak,
        walnut,
        sofa,
        armchair,
        linen,
        books,
        fruits,
        lacquer: plain("lacquer", [0.8, 0.8, 0.77], 0.3, 0.0),
        steel: plain("brushed steel", [0.66, 0.66, 0.67], 0.28, 1.0),
        brass: plain("brass", [0.85, 0.64, 0.32], 0.22, 1.0),
        black_metal: plain("black metal", [0.03, 0.03, 0.033], 0.4, 0.0),
        ceramic: plain("ceramic", [0.82, 0.81, 0.78], 0.12, 0.0),
        glaze: plain("blue glaze", [0.05, 0.16, 0.3], 0.08, 0.0),
        terracotta: plain("terracotta", [0.55, 0.24, 0.13], 0.85, 0.0),
        soil: plain("soil", [0.06, 0.04, 0.03], 1.0, 0.0),
        leaf: plain("leaf", [0.07, 0.22, 0.06], 0.45, 0.0),
        paper: plain("paper", [0.85, 0.83, 0.78], 0.9, 0.0),
        lamp: writer.material(lamp("diffuser", [1.0, 0.74, 0.45], 60.0)),
        shade: writer.material(lamp("lamp shade", [1.0, 0.72, 0.42], 7.0)),
        panel: writer.material(lamp("light panel", [1.0, 0.86, 0.68], 14.0)),
        screen: writer.material(lamp("screen", [0.45, 0.62, 1.0], 1.6)),
        glass: writer.material(json!({"name": "glass",
            "pbrMetallicRoughness": {"baseColorFactor": [1.0, 1.0, 1.0, 1.0], "metallicFactor": 0.0, "roughnessFactor": 0.0},
            "extensions": {"KHR_materials_transmission": {"transmissionFactor": 1.0},
                "KHR_materials_ior": {"ior": 1.5},
                "KHR_materials_volume": {"thicknessFactor": 0.01, "attenuationDistance": 0.12,
                    "attenuationColor": [0.7, 0.93, 0.85]}}})),
    };
    (palette, surfaces)
}

/// Openings: along the wall from its start, then heights.
const SOUTH: [Opening; 3] = [[0.8, 3.4, 0.95, 2.3], [5.0, 6.8, 0.4, 2.35], [7.5, 9.3, 0.4, 2.35]];
const WEST: [Opening; 1] = [[6.3, 7.7, 0.9, 2.2]];
const EAST: [Opening; 1] = [[0.9, 2.3, 0.95, 2.2]];
const DOOR: [Opening; 1] = [[3.1, 4.05, -1.0, 2.1]];
const PASSAGE: [Opening; 1] = [[1.45, 4.05, -1.0, 2.25]];

fn build_shell(writer: &mut Writer, s: &Shell, p: &Palette) {
    let heights = [-SUNK, CEILING + SUNK];
    let stand = |start: [f32; 2], end: [f32; 2], thickness: f32, openings: &[Opening]| {
        wall(Vec2::from_array(start), Vec2::from_array(end), thickness, heights, openings)
    };
    let mut walls = Object::default();
    walls.add(s.plaster, stand([10.2, 5.0], [-0.2, 5.0], 0.25, &SOUTH));
    walls.add(s.plaster, stand([0.0, 5.1], [0.0, -3.6], 0.25, &WEST));
    walls.add(s.plaster, stand([10.0, -0.1], [10.0, 5.1], 0.25, &EAST));
    walls.add(s.accent, stand([-0.1, 0.0], [10.1, 0.0], 0.15, &DOOR));
    walls.add(s.plaster, stand([-0.1, -3.5], [4.6, -3.5], 0.2, &[]));
    walls.add(s.plaster, stand([4.5, -3.6], [4.5, -0.1], 0.15, &[]));
    walls.add(s.plaster, stand([6.0, -0.05], [6.0, 5.05], 0.15, &PASSAGE));
    writer.place("walls", walls);

    let slab = |x: [f32; 2], y: [f32; 2], z: [f32; 2]| {
        Mesh::block(x[1] - x[0], y[1] - y[0], z[1] - z[0]).at(
            f32::midpoint(x[0], x[1]),
            y[0],
            f32::midpoint(z[0], z[1]),
        )
    };
    let mut floors = Object::default();
    floors.add(s.boards, slab([-0.26, 6.075], [-0.2, 0.0], [-3.72, 5.26]));
    floors.add(s.floor_tiles, slab([6.075, 10.26], [-0.2, 0.0], [-0.16, 5.26]));
    // covers the joint of the two floors in the passage
    floors.add(p.oak, slab([5.99, 6.16], [-0.01, 0.012], [1.39, 4.01]));
    floors.add(s.ceiling, slab([-0.27, 10.27], [CEILING, CEILING + 0.2], [-3.73, 5.27]));
    writer.place("floors and ceiling", floors);

    // frames of the windows: a sash with one bar across, set into the reveal
    let mut frames = Object::default();
    let sash = |object: &mut Object, width: f32, height: f32, place: &dyn Fn(Mesh) -> Mesh| {
        let (bar, deep) = (0.05, 0.06);
        let mut mesh = Mesh::default();
        for y in [-0.004, height - bar + 0.004] {
            mesh.add(Mesh::block(width + 0.008, bar, deep).at(0.0, y, 0.0));
        }
        let upright = height - 2.0 * bar + 0.016;
        for x in [-(width - bar) / 2.0 - 0.004, 0.0, (width - bar) / 2.0 + 0.004] {
            mesh.add(Mesh::block(bar, upright, deep - 0.01).at(x, bar - 0.008, 0.0));
        }
        object.add(s.paint, place(mesh));
    };
    for [from, to, low, high] in SOUTH {
        let x = 10.2 - f32::midpoint(from, to);
        sash(&mut frames, to - from, high - low, &|mesh| mesh.at(x, low, 5.17));
        frames.add(s.paint, Mesh::pillow(to - from + 0.1, 0.03, 0.2, 0.008, 1).at(x, low - 0.02, 5.0));
    }
    for [from, to, low, high] in WEST {
        let z = 5.1 - f32::midpoint(from, to);
        sash(&mut frames, to - from, high - low, &|mesh| mesh.turned(90.0).at(-0.17, low, z));
        frames.add(s.paint, Mesh::pillow(0.2, 0.03, to - from + 0.1, 0.008, 1).at(0.0, low - 0.02, z));
    }
    for [from, to, low, high] in EAST {
        let z = f32::midpoint(from, to) - 0.1;
        sash(&mut frames, to - from, high - low, &|mesh| mesh.turned(90.0).at(10.17, low, z));
        frames.add(s.paint, Mesh::pillow(0.2, 0.03, to - from + 0.1, 0.008, 1).at(10.0, low - 0.02, z));
    }
    // door case
    for x in [2.99, 3.96] {
        frames.add(s.paint, Mesh::block(0.08, 2.14, 0.2).at(x, 0.0, -0.075));
    }
    frames.add(s.paint, Mesh::block(1.05, 0.08, 0.196).at(3.475, 2.07, -0.075));
    writer.place("frames", frames);

    skirting(writer, s);
    outside(writer, s);
}

/// Skirting boards along the walls that show.
fn skirting(writer: &mut Writer, s: &Shell) {
    let mut boards = Object::default();
    let (high, thick) = (0.08, 0.015);
    let mut along_x = |from: f32, to: f32, z: f32| {
        boards.add(s.paint, Mesh::block(to - from, high, thick).at(f32::midpoint(from, to), -0.002, z));
    };
    along_x(0.0, 2.95, 0.0065);
    along_x(4.0, 6.0, 0.0065);
    along_x(0.0, 6.0, 4.9935);
    along_x(6.15, 10.0, 4.9935);
    along_x(0.0, 2.95, -0.1565);
    along_x(4.0, 4.5, -0.1565);
    along_x(0.0, 4.5, -3.4935);
    let mut along_z = |from: f32, to: f32, x: f32| {
        boards.add(s.paint, Mesh::block(thick, high - 0.002, to - from).at(x, -0.002, f32::midpoint(from, to)));
    };
    along_z(0.0, 5.0, 0.0065);
    along_z(0.0, 5.0, 9.9935);
    along_z(0.0, 1.4, 5.9935);
    along_z(4.0, 5.0, 5.9935);
    along_z(0.0, 1.4, 6.1565);
    along_z(4.0, 5.0, 6.1565);
    along_z(-3.5, -0.15, 0.0065);
    along_z(-3.5, -0.15, 4.4935);
    writer.place("skirting", boards);
}

/// A lawn with trees, so that the windows look out on something.
fn outside(writer: &mut Writer, s: &Shell) {
    let mut garden = Object::default();
    garden.add(s.grass, Mesh::block(44.0, 0.1, 40.0).at(5.0, -0.35, 4.0));
    let hedge = Mesh::pillow(34.0, 1.15, 1.0, 0.3, 3).at(4.0, -0.27, 16.5);
    garden.add(s.foliage, hedge);
    writer.place("garden", garden);
    let mut tree = Object::default();
    tree.add(s.bark, Mesh::tube(&[Vec3::Y * -0.3, Vec3::new(0.05, 0.8, 0.0), Vec3::new(0.0, 2.2, 0.05)], 0.12, 12));
    for k in 0..9 {
        let random = |n: i32| texture::hash(k, n, 77);
        let (x, y, z) = (random(0) - 0.5, random(1), random(2) - 0.5);
        tree.add(s.foliage, Mesh::ball(0.55 + 0.4 * random(3), 8).at(x * 1.9, 2.1 + y * 1.5, z * 1.9));
    }
    let trees = [
        (-3.5, 13.5, 10.0),
        (1.2, 14.6, 80.0),
        (6.6, 13.8, 200.0),
        (11.5, 14.2, 310.0),
        (-8.0, -1.0, 45.0),
        (-9.5, -4.6, 130.0),
    ];
    let placed: Vec<(Vec3, f32)> = trees.iter().map(|&(x, z, turn)| (Vec3::new(x, 0.0, z), turn)).collect();
    writer.repeat("tree", tree, &placed);
}

/// A rug whose picture spans it once.
fn rug(material: MaterialId, width: f32, depth: f32) -> Object {
    let mut mesh = Mesh::block(width, 0.012, depth);
    for (uv, p) in mesh.uvs.iter_mut().zip(&mesh.positions) {
        *uv = Vec2::new(p.x / width + 0.5, p.z / depth + 0.5);
    }
    let mut object = Object::default();
    object.add(material, mesh);
    object
}

/// Height of what stands on a rug: the rug's top, less a hair so that nothing hovers.
const ON_RUG: f32 = 0.0115;

fn living_room(writer: &mut Writer, p: &Palette, s: &Shell) {
    let at = |x: f32, y: f32, z: f32, turn: f32| [(Vec3::new(x, y, z), turn)];
    writer.repeat("rug", rug(s.rug, 3.0, 2.1), &at(1.75, 0.0005, 1.95, 0.0));
    writer.repeat("sofa", f::sofa(p, 3, p.sofa), &at(1.65, 0.0, 0.52, 0.0));
    let chairs = [(Vec3::new(1.0, 0.0, 3.75), 164.0), (Vec3::new(3.85, 0.0, 2.0), -80.0)];
    writer.repeat("armchair", f::sofa(p, 1, p.armchair), &chairs);
    writer.repeat("coffee table", f::coffee_table(p), &at(1.7, ON_RUG, 1.75, 0.0));
    writer.repeat("bookcase", f::bookcase(p, 1.7, 2.25, 41), &at(5.1, 0.0, 0.19, 0.0));
    writer.repeat("sideboard", f::sideboard(p, 1.6), &at(0.24, 0.0, 2.4, 90.0));
    writer.repeat("table lamp", f::table_lamp(p), &at(0.24, 0.6845, 1.85, 0.0));
    writer.repeat("floor lamp", f::floor_lamp(p), &at(3.0, 0.0, 0.35, 0.0).map(|(v, t)| (v - Vec3::X * 0.12, t)));
    let mut ornaments = Object::default();
    ornaments.add(p.glaze, f::vase(0.34).at(0.24, 0.6845, 2.95));
    ornaments.add(p.brass, Mesh::ball(0.07, 10).at(0.24, 0.7545, 2.65));
    writer.place("ornaments", ornaments);
    writer.repeat("plant", f::plant(p, 1.15, 46, 5), &at(0.45, 0.0, 4.5, 0.0));
    writer.repeat("plant", f::plant(p, 0.8, 36, 9), &at(5.6, 0.0, 0.85, 0.0).map(|(v, t)| (v + Vec3::Z * 0.15, t)));
    writer.repeat("picture", f::picture(p, s.paintings[0], 0.95, 0.65), &at(1.1, 1.35, 0.0005, 0.0));
    writer.repeat("picture", f::picture(p, s.paintings[1], 0.7, 0.5), &at(2.15, 1.42, 0.0005, 0.0));
    writer.repeat("picture", f::picture(p, s.paintings[2], 0.9, 0.62), &at(0.0005, 1.3, 2.5, 90.0));
    let curtain = f::curtain(p, 0.42, 2.52, 4.0);
    let places = [0.72, 2.88, 3.22, 5.38].map(|x| (Vec3::new(x, 0.0, 4.9), 0.0));
    writer.repeat("curtain", curtain, &places);
    let mut rod = Object::default();
    rod.add(p.brass, Mesh::tube(&[Vec3::new(0.4, 2.54, 4.9), Vec3::new(5.7, 2.54, 4.9)], 0.012, 12));
    for x in [0.45, 3.05, 5.65] {
        rod.add(p.brass, Mesh::tube(&[Vec3::new(x, 2.54, 4.89), Vec3::new(x, 2.54, 5.01)], 0.008, 10));
    }
    writer.place("curtain rod", rod);
}

fn kitchen_room(writer: &mut Writer, p: &Palette, surfaces: &Surfaces, s: &Shell) {
    let at = |x: f32, y: f32, z: f32, turn: f32| [(Vec3::new(x, y, z), turn)];
    writer.repeat("counter", kitchen::counter(p, surfaces, 3.0), &at(6.96, 0.0, 0.0, 0.0));
    writer.repeat("wall units", kitchen::wall_units(p, 3.0), &at(6.96, 0.0, 0.0, 0.0));
    writer.repeat("refrigerator", kitchen::refrigerator(p), &at(6.56, 0.0, 0.005, 0.0));
    writer.repeat("dining table", kitchen::dining_table(p), &at(8.1, 0.0, 3.1, 0.0));
    let mut chairs = Vec::new();
    for (k, x) in [7.5, 8.1, 8.7].into_iter().enumerate() {
        let turn = [6.0, -4.0, 9.0][k];
        chairs.push((Vec3::new(x, 0.0, 2.42), turn));
        chairs.push((Vec3::new(x, 0.0, 3.78), 180.0 - turn));
    }
    writer.repeat("chair", f::chair(p), &chairs);
    let lamps = [7.6, 8.6].map(|x| (Vec3::new(x, 1.62, 3.1), 0.0));
    writer.repeat("pendant lamp", f::pendant(p, CEILING - 1.62 + 0.01), &lamps);
    writer.repeat("picture", f::picture(p, s.paintings[3], 0.9, 0.65), &at(9.9995, 1.3, 3.1, -90.0));
    writer.repeat("plant", f::plant(p, 0.9, 38, 15), &at(9.6, 0.0, 4.6, 0.0));
}

fn study(writer: &mut Writer, p: &Palette, s: &Shell) {
    let at = |x: f32, y: f32, z: f32, turn: f32| [(Vec3::new(x, y, z), turn)];
    let mut ceiling_lamp = Object::default();
    ceiling_lamp.add(p.panel, Mesh::cylinder(0.22, 0.08, 28).at(2.2, CEILING - 0.07, -1.8));
    writer.place("ceiling lamp", ceiling_lamp);
    writer.repeat("study rug", rug(s.study_rug, 2.0, 1.5), &at(2.2, 0.0005, -1.8, 0.0));
    writer.repeat("desk", f::desk(p), &at(0.4, 0.0, -1.9, 90.0));
    writer.repeat("desk chair", f::chair(p), &at(1.0, 0.0, -1.75, -104.0));
    writer.repeat("desk lamp", f::table_lamp(p), &at(0.28, 0.7495, -1.35, 0.0));
    writer.repeat("bookcase", f::bookcase(p, 1.5, 1.95, 97), &at(1.6, 0.0, -3.31, 0.0));
    writer.repeat("daybed", f::daybed(p), &at(4.0, 0.0, -2.1, -90.0));
    writer.repeat("picture", f::picture(p, s.paintings[0], 0.9, 0.6), &at(4.4995, 1.35, -2.1, -90.0));
    writer.repeat("plant", f::plant(p, 0.7, 30, 23), &at(2.75, 0.0, -3.2, 0.0));
}
