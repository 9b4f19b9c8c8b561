//! Snapshots of a cache on disk: written when a session ends, read when the same scene is opened again.
//!
//! Layout: magic, version, identity and counts in a fixed header, then the live surfels in the order of their ids,
//! column by column, compressed with zlib, then a SHA-256 over everything before it. A snapshot that does not fit is
//! refused, never repaired: a new cache is filled within seconds.

use std::io::{Read as _, Write as _};

use flate2::Compression;
use flate2::read::ZlibDecoder;
use flate2::write::ZlibEncoder;
use sha2::{Digest as _, Sha256};
use surfelcast_gpu::{Buffer, Gpu, GpuError};
use surfelcast_passes::upload::SceneBuffers;
use surfelcast_render_api::Settings;
use surfelcast_render_api::identity::identity;
use surfelcast_shaders::constants::SURFEL_TILE_WORDS;
use surfelcast_shaders::layout::bytemuck::{self, Pod};
use surfelcast_shaders::records::{SurfelEdge, SurfelLight, SurfelOutput, SurfelRecord};

use super::SurfelCache;
use super::neighbours::EDGE_SLOTS;
use crate::session::SnapshotIdentity;
use crate::surfel::settings::SurfelSettings;

const MAGIC: [u8; 8] = *b"surfels\0";
/// Format version, raised whenever the meaning of a byte changes.
const VERSION: u32 = 3;
/// Bytes before the compressed columns.
const HEADER_BYTES: usize = 8 + 4 + 3 * 32 + 4 * 4;
const HASH_BYTES: usize = 32;
/// Bytes of one readback.
const CHUNK_BYTES: u64 = 32 << 20;

/// Why a snapshot was refused.
#[derive(Debug, thiserror::Error)]
pub enum SnapshotError {
    /// Not a snapshot, or truncated, or altered.
    #[error("the snapshot is damaged: {0}")]
    Damaged(&'static str),
    /// A snapshot of something else.
    #[error("the snapshot belongs to {0}")]
    Foreign(&'static str),
    /// The device.
    #[error(transparent)]
    Gpu(#[from] GpuError),
}

/// Content of a column, as far as it is checked.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Content {
    Records,
    Lights,
    Outputs,
    /// Any bits are valid.
    Words,
    /// Finite floats.
    Numbers,
    /// [`EDGE_SLOTS`] of `SurfelEdge`, whose neighbours are numbered in the order of the ids.
    Edges,
}

/// One column: a buffer with an element for each id.
struct Column<'a> {
    content: Content,
    buffer: &'a Buffer,
    bytes_each: usize,
}

impl SurfelCache {
    fn columns(&self) -> Vec<Column<'_>> {
        let column = |content, buffer, bytes_each| Column { content, buffer, bytes_each };
        let mut columns = vec![
            column(Content::Records, &self.memory.records, size_of::<SurfelRecord>()),
            column(Content::Lights, &self.memory.lights, size_of::<SurfelLight>()),
            column(Content::Outputs, &self.memory.outputs, size_of::<SurfelOutput>()),
            column(Content::Words, &self.memory.tiles, SURFEL_TILE_WORDS as usize * 4),
            column(Content::Words, &self.memory.flags, 4),
        ];
        if let Some(neighbours) = &self.neighbours {
            columns.extend(neighbours.kept_numbers().map(|buffer| column(Content::Numbers, buffer, 16)));
            let edge_bytes = EDGE_SLOTS as usize * size_of::<SurfelEdge>();
            columns.push(column(Content::Edges, neighbours.edges(), edge_bytes));
        }
        columns
    }

    /// The live surfels as bytes.
    pub fn save(&self, gpu: &Gpu, identity: &SnapshotIdentity) -> Result<Vec<u8>, GpuError> {
        let ids: Vec<u32> = read::<u32>(gpu, &self.memory.lists, u64::from(self.live))?;
        let mut bytes = Vec::with_capacity(HEADER_BYTES);
        bytes.extend_from_slice(&MAGIC);
        bytes.extend_from_slice(&VERSION.to_le_bytes());
        bytes.extend_from_slice(&identity.scene);
        bytes.extend_from_slice(&identity.lights);
        bytes.extend_from_slice(&settings_hash(&self.settings));
        for number in [self.live, self.next_serial, self.updates.number, self.updates.since_relight] {
            bytes.extend_from_slice(&number.to_le_bytes());
        }
        let mut encoder = ZlibEncoder::new(bytes, Compression::fast());
        for Column { content, buffer, bytes_each } in self.columns() {
            let all: Vec<u8> = read(gpu, buffer, u64::from(self.used) * bytes_each as u64)?;
            for &id in &ids {
                let start = id as usize * bytes_each;
                let own = all.get(start..start + bytes_each).unwrap_or_default();
                // Writing to memory cannot fail.
                let _ = match content {
                    Content::Edges => encoder.write_all(&renumbered(own, &ids)),
                    _ => encoder.write_all(own),
                };
            }
        }
        let mut bytes = encoder.finish().unwrap_or_default();
        let hash = Sha256::digest(&bytes);
        bytes.extend_from_slice(&hash);
        Ok(bytes)
    }

    /// The cache of a snapshot. If the lights differ from those of the snapshot, the surfels stay and their light is
    /// measured again.
    pub fn restore(
        gpu: &Gpu,
        scene: &SceneBuffers,
        settings: SurfelSettings,
        pixel_count: u32,
        seed: u64,
        identity: &SnapshotIdentity,
        bytes: &[u8],
    ) -> Result<Self, SnapshotError> {
        let header = Header::read(bytes)?;
        if header.scene != identity.scene {
            return Err(SnapshotError::Foreign("another scene"));
        }
        if header.settings != settings_hash(&settings) {
            return Err(SnapshotError::Foreign("other settings"));
        }
        let mut cache = Self::new(gpu, scene, settings, pixel_count, seed)?;
        let live = header.live;
        if live > cache.capacity {
            return Err(SnapshotError::Foreign("a cache that is larger than this device's"));
        }
        let body = &bytes[HEADER_BYTES..bytes.len() - HASH_BYTES];
        let expected: usize = cache.columns().iter().map(|column| column.bytes_each * live as usize).sum();
        let mut columns = Vec::new();
        // One byte more than expected, to detect a body that is too long.
        let decoded = ZlibDecoder::new(body).take(expected as u64 + 1).read_to_end(&mut columns);
        if decoded.is_err() || columns.len() != expected {
            return Err(SnapshotError::Damaged("its columns do not unpack to the size it states"));
        }
        let mut rest = columns.as_slice();
        for Column { content, buffer, bytes_each } in cache.columns() {
            let (column, behind) = rest.split_at(bytes_each * live as usize);
            check(content, column, live, scene)?;
            gpu.upload(buffer, 0, column)?;
            rest = behind;
        }
        let ids: Vec<u32> = (0..live).collect();
        gpu.upload(&cache.memory.lists, 0, bytemuck::cast_slice(&ids))?;
        (cache.live, cache.used) = (live, live);
        cache.next_serial = header.next_serial;
        cache.updates.number = header.update.max(1);
        cache.updates.since_relight = header.since_relight;
        cache.awaits_insertion = true;
        if header.lights != identity.lights {
            cache.relight();
        }
        Ok(cache)
    }
}

struct Header {
    scene: [u8; 32],
    lights: [u8; 32],
    settings: [u8; 32],
    live: u32,
    next_serial: u32,
    update: u32,
    since_relight: u32,
}

impl Header {
    fn read(bytes: &[u8]) -> Result<Self, SnapshotError> {
        if bytes.len() < HEADER_BYTES + HASH_BYTES || bytes[..8] != MAGIC {
            return Err(SnapshotError::Damaged("it does not begin like a snapshot"));
        }
        let number = |at: usize| u32::from_le_bytes([bytes[at], bytes[at + 1], bytes[at + 2], bytes[at + 3]]);
        if number(8) != VERSION {
            return Err(SnapshotError::Foreign("another version of the program"));
        }
        let (content, hash) = bytes.split_at(bytes.len() - HASH_BYTES);
        if Sha256::digest(content).as_slice() != hash {
            return Err(SnapshotError::Damaged("its checksum is wrong"));
        }
        let hash_at = |at: usize| {
            let mut hash = [0; 32];
            hash.copy_from_slice(&bytes[at..at + 32]);
            hash
        };
        Ok(Self {
            scene: hash_at(12),
            lights: hash_at(44),
            settings: hash_at(76),
            live: number(108),
            next_serial: number(112),
            update: number(116),
            since_relight: number(120),
        })
    }
}

/// A surfel's edges with neighbours numbered in the order of the ids; slots of recycled neighbours become empty.
fn renumbered(own: &[u8], ids: &[u32]) -> Vec<u8> {
    let mut edges: Vec<SurfelEdge> = bytemuck::pod_collect_to_vec(own);
    for edge in &mut edges {
        match ids.binary_search(&edge.neighbour) {
            Ok(place) if edge.serial != 0 => edge.neighbour = place as u32,
            _ => {
                *edge =
                    SurfelEdge { neighbour: 0, serial: 0, count: 0.0, square: 0.0, difference: [0.0; 3], padding: 0 }
            }
        }
    }
    bytemuck::cast_slice(&edges).to_vec()
}

/// Checks that no index leads a kernel out of a buffer, and that no value makes a mean NaN.
fn check(content: Content, column: &[u8], live: u32, scene: &SceneBuffers) -> Result<(), SnapshotError> {
    let all_finite = |values: &[f32]| values.iter().all(|value| value.is_finite());
    let is_sound = match content {
        Content::Words => true,
        Content::Numbers => all_finite(&bytemuck::pod_collect_to_vec::<u8, f32>(column)),
        Content::Records => {
            let [triangles, instances] = scene.attachment_counts();
            let is_sound = |record: &SurfelRecord| {
                record.bvh_triangle < triangles
                    && record.instance < instances
                    && record.level <= 31
                    && record.radius > 0.0
                    && all_finite(&record.position)
                    && all_finite(&record.barycentrics)
                    && record.radius.is_finite()
            };
            if !bytemuck::pod_collect_to_vec(column).iter().all(is_sound) {
                return Err(SnapshotError::Damaged("a surfel is attached to nothing in the scene"));
            }
            true
        }
        Content::Lights => bytemuck::pod_collect_to_vec(column).iter().all(|light: &SurfelLight| {
            let scalars = [
                light.ray_count,
                light.variance,
                light.short_mean,
                light.drift,
                light.age,
                light.guide_scale,
                light.short_variance,
                light.blend_ratio,
                light.fresh_rays,
            ];
            all_finite(&light.indirect) && all_finite(&light.direct) && all_finite(&scalars)
        }),
        Content::Outputs => bytemuck::pod_collect_to_vec(column).iter().all(|output: &SurfelOutput| {
            // Half floats whose exponent bits are all set are not finite.
            let mut halves = output.gradient.iter().flat_map(|word| [word & 0x7fff, word >> 16 & 0x7fff]);
            all_finite(&output.indirect)
                && all_finite(&output.direct)
                && all_finite(&[output.ray_count, output.variance])
                && halves.all(|half| half & 0x7c00 != 0x7c00)
        }),
        Content::Edges => {
            let is_sound = |edge: &SurfelEdge| {
                edge.neighbour < live.max(1)
                    && all_finite(&edge.difference)
                    && all_finite(&[edge.count, edge.square])
                    && edge.count >= 0.0
                    && edge.square >= 0.0
            };
            if !bytemuck::pod_collect_to_vec(column).iter().all(is_sound) {
                return Err(SnapshotError::Damaged("an edge leads to no surfel"));
            }
            true
        }
    };
    if is_sound { Ok(()) } else { Err(SnapshotError::Damaged("a surfel's light is not finite")) }
}

fn settings_hash(settings: &SurfelSettings) -> [u8; 32] {
    // Settings are a map of names, which always encodes.
    identity(&Settings::from(settings.of_content())).unwrap_or_default()
}

/// The first `count` items of a buffer.
pub(super) fn read<T: Pod>(gpu: &Gpu, buffer: &Buffer, count: u64) -> Result<Vec<T>, GpuError> {
    let end = count * size_of::<T>() as u64;
    let mut bytes = Vec::with_capacity(end as usize);
    let mut at = 0;
    while at < end {
        let next = (at + CHUNK_BYTES).min(end);
        let mut graph = gpu.graph("surfel_snapshot");
        let ticket = graph.read_back(buffer, at..next)?;
        bytes.extend(graph.submit()?.wait()?.take(ticket)?);
        at = next;
    }
    Ok(bytemuck::pod_collect_to_vec(&bytes))
}

/// A live surfel, as it is exported to a point cloud.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ExportedSurfel {
    /// Where it is.
    pub record: SurfelRecord,
    /// What it measured.
    pub light: SurfelLight,
}

impl SurfelCache {
    /// Every live surfel, in the order of the ids.
    pub fn export(&self, gpu: &Gpu) -> Result<Vec<ExportedSurfel>, GpuError> {
        let ids: Vec<u32> = read(gpu, &self.memory.lists, u64::from(self.live))?;
        let records: Vec<SurfelRecord> = read(gpu, &self.memory.records, u64::from(self.used))?;
        let lights: Vec<SurfelLight> = read(gpu, &self.memory.lights, u64::from(self.used))?;
        let pairs = ids.iter().filter_map(|&id| Some((records.get(id as usize)?, lights.get(id as usize)?)));
        Ok(pairs.map(|(&record, &light)| ExportedSurfel { record, light }).collect())
    }
}
