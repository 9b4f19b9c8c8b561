//! A small writer of GLB files, for the scenes the project generates itself (demo, tests, benchmarks).

use serde_json::{Map, Value, json};

/// Collects JSON items and binary data, then writes a GLB.
#[derive(Clone, Debug)]
pub struct GlbBuilder {
    root: Map<String, Value>,
    binary: Vec<u8>,
}

impl Default for GlbBuilder {
    fn default() -> Self {
        Self::new()
    }
}

impl GlbBuilder {
    /// An empty file with one scene.
    pub fn new() -> Self {
        let mut root = Map::new();
        root.insert("asset".to_owned(), json!({"version": "2.0", "generator": "surfelcast"}));
        root.insert("scene".to_owned(), json!(0));
        root.insert("scenes".to_owned(), json!([{"nodes": []}]));
        Self { root, binary: Vec::new() }
    }

    /// Appends an item to a top-level array (`"materials"`, `"nodes"`, ...) and returns its index.
    pub fn push(&mut self, array: &str, item: Value) -> usize {
        let list = self.root.entry(array).or_insert_with(|| json!([]));
        match list.as_array_mut() {
            Some(list) => {
                list.push(item);
                list.len() - 1
            }
            None => 0,
        }
    }

    /// Sets a top-level member.
    pub fn set(&mut self, member: &str, value: Value) {
        self.root.insert(member.to_owned(), value);
    }

    /// Appends a node and makes it a root of the scene.
    pub fn root_node(&mut self, node: Value) -> usize {
        let index = self.push("nodes", node);
        if let Some(roots) = self.root.get_mut("scenes").and_then(|s| s[0]["nodes"].as_array_mut()) {
            roots.push(json!(index));
        }
        index
    }

    /// Names an extension as used.
    pub fn use_extension(&mut self, name: &str) {
        let list = self.root.entry("extensionsUsed").or_insert_with(|| json!([]));
        if let Some(list) = list.as_array_mut().filter(|list| !list.iter().any(|known| known == name)) {
            list.push(json!(name));
        }
    }

    /// Names an extension as used and required.
    pub fn require_extension(&mut self, name: &str) {
        self.use_extension(name);
        let list = self.root.entry("extensionsRequired").or_insert_with(|| json!([]));
        if let Some(list) = list.as_array_mut().filter(|list| !list.iter().any(|known| known == name)) {
            list.push(json!(name));
        }
    }

    /// Appends bytes as a buffer view of their own, aligned to 4, and returns its index.
    pub fn view(&mut self, bytes: &[u8]) -> usize {
        self.binary.resize(self.binary.len().next_multiple_of(4), 0);
        let offset = self.binary.len();
        self.binary.extend_from_slice(bytes);
        self.push("bufferViews", json!({"buffer": 0, "byteOffset": offset, "byteLength": bytes.len()}))
    }

    /// Appends an accessor over its own buffer view.
    pub fn accessor(&mut self, bytes: &[u8], component: u32, count: usize, shape: &str, normalized: bool) -> usize {
        let view = self.view(bytes);
        self.push(
            "accessors",
            json!({"bufferView": view, "componentType": component, "count": count, "type": shape,
                   "normalized": normalized}),
        )
    }

    /// Appends an accessor whose elements stand `stride` bytes apart.
    pub fn strided(
        &mut self,
        bytes: &[u8],
        stride: usize,
        component: u32,
        count: usize,
        shape: &str,
        normalized: bool,
    ) -> usize {
        let index = self.accessor(bytes, component, count, shape, normalized);
        if let Some(view) = self.root.get_mut("bufferViews").and_then(Value::as_array_mut).and_then(|v| v.last_mut()) {
            view["byteStride"] = json!(stride);
        }
        index
    }

    /// Appends a float accessor of 1- to 4-component vectors.
    pub fn floats<const N: usize>(&mut self, values: &[[f32; N]]) -> usize {
        let shape = ["SCALAR", "SCALAR", "VEC2", "VEC3", "VEC4"].get(N).copied().unwrap_or("MAT4");
        let index = self.accessor(bytemuck::cast_slice(values.as_flattened()), 5126, values.len(), shape, false);
        // readers may rely on the bounds of positions
        if N == 3 && !values.is_empty() {
            let bound = |pick: fn(f32, f32) -> f32| -> Vec<f32> {
                (0..N).map(|k| values.iter().map(|v| v[k]).reduce(pick).unwrap_or_default()).collect()
            };
            let (low, high) = (bound(f32::min), bound(f32::max));
            if let Some(accessor) = self.root.get_mut("accessors").and_then(|list| list.get_mut(index)) {
                accessor["min"] = json!(low);
                accessor["max"] = json!(high);
            }
        }
        index
    }

    /// Appends 16-bit indices where they fit, else 32-bit ones.
    pub fn indices(&mut self, triangles: &[[u32; 3]]) -> usize {
        let flat = triangles.as_flattened();
        if flat.iter().all(|&index| index < 0xffff) {
            let short: Vec<u16> = flat.iter().map(|&index| index as u16).collect();
            return self.accessor(bytemuck::cast_slice(&short), 5123, flat.len(), "SCALAR", false);
        }
        self.accessor(bytemuck::cast_slice(flat), 5125, flat.len(), "SCALAR", false)
    }

    /// Appends a PNG or JPEG image with a texture of the given sampler members.
    pub fn texture(&mut self, encoded: &[u8], mime: &str, sampler: Value) -> usize {
        let view = self.view(encoded);
        let source = self.push("images", json!({"bufferView": view, "mimeType": mime}));
        let sampler = self.push("samplers", sampler);
        self.push("textures", json!({"source": source, "sampler": sampler}))
    }

    /// The JSON as it stands, without the buffer's length.
    pub fn json(&self) -> Value {
        Value::Object(self.root.clone())
    }

    /// Writes the file.
    pub fn finish(mut self) -> Vec<u8> {
        self.binary.resize(self.binary.len().next_multiple_of(4), 0);
        if !self.binary.is_empty() {
            self.root.insert("buffers".to_owned(), json!([{"byteLength": self.binary.len()}]));
        }
        let json = Value::Object(self.root).to_string().into_bytes();
        pack(&json, &self.binary)
    }
}

/// Packs JSON and binary data into a GLB; an empty `binary` leaves the chunk out.
pub fn pack(json: &[u8], binary: &[u8]) -> Vec<u8> {
    let json_length = json.len().next_multiple_of(4);
    let binary_length = binary.len().next_multiple_of(4);
    let total = 20 + json_length + if binary.is_empty() { 0 } else { 8 + binary_length };
    let mut out = Vec::with_capacity(total);
    let word = |out: &mut Vec<u8>, value: usize| out.extend_from_slice(&(value as u32).to_le_bytes());
    out.extend_from_slice(b"glTF");
    word(&mut out, 2);
    word(&mut out, total);
    word(&mut out, json_length);
    out.extend_from_slice(b"JSON");
    out.extend_from_slice(json);
    out.resize(20 + json_length, b' ');
    if !binary.is_empty() {
        word(&mut out, binary_length);
        out.extend_from_slice(b"BIN\0");
        out.extend_from_slice(binary);
        out.resize(total, 0);
    }
    out
}
