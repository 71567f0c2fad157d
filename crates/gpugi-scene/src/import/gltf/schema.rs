//! The parts of the glTF 2.0 JSON that gpugi reads.
//!
//! These structs are custom. Those of the `gltf` crate do not fit: its validation indexes lists with unchecked numbers
//! from the file, it rejects `EXT_meshopt_compression`, and it does not read unknown extensions in place. Here indices
//! are plain numbers; whoever uses an index checks it.

mod material;
mod numbers;

use std::collections::BTreeMap;

use serde::Deserialize;
use serde_json::{Map, Value};

use crate::names::Name;
pub use material::{Material, SpecularGlossiness, TextureInfo};
use numbers::{any_number, finite, one, ones};

/// Extensions and extras for which gpugi has no types.
pub type Others = Map<String, Value>;

#[derive(Debug, Default, Deserialize)]
#[serde(default, rename_all = "camelCase")]
pub struct Root {
    pub asset: Asset,
    pub extensions_used: Vec<String>,
    pub extensions_required: Vec<String>,
    pub extensions: RootExtensions,
    pub scene: Option<usize>,
    pub scenes: Vec<SceneNodes>,
    pub nodes: Vec<Node>,
    pub meshes: Vec<Mesh>,
    pub accessors: Vec<Accessor>,
    pub buffer_views: Vec<BufferView>,
    pub buffers: Vec<Buffer>,
    pub materials: Vec<Material>,
    pub textures: Vec<Texture>,
    pub images: Vec<Image>,
    pub samplers: Vec<Sampler>,
    pub cameras: Vec<Camera>,
    pub skins: Vec<Skin>,
    pub animations: Vec<Animation>,
    pub extras: Value,
}

#[derive(Debug, Default, Deserialize)]
#[serde(default, rename_all = "camelCase")]
pub struct Asset {
    pub version: String,
    pub min_version: Option<String>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(default)]
pub struct RootExtensions {
    #[serde(rename = "KHR_lights_punctual")]
    pub lights: Lights,
}

#[derive(Debug, Default, Deserialize)]
#[serde(default)]
pub struct Lights {
    pub lights: Vec<Light>,
}

#[derive(Debug, Deserialize)]
pub struct Light {
    pub name: Option<Name>,
    #[serde(rename = "type")]
    pub kind: String,
    #[serde(default = "ones")]
    pub color: [f32; 3],
    /// Units: [`crate::Light::intensity`].
    #[serde(default = "one", deserialize_with = "any_number")]
    pub intensity: f32,
    pub range: Option<f32>,
    #[serde(default)]
    pub spot: Spot,
    #[serde(default)]
    pub extras: Value,
}

#[derive(Debug, Deserialize)]
#[serde(default, rename_all = "camelCase")]
pub struct Spot {
    #[serde(deserialize_with = "any_number")]
    pub inner_cone_angle: f32,
    #[serde(deserialize_with = "any_number")]
    pub outer_cone_angle: f32,
}

impl Default for Spot {
    fn default() -> Self {
        Self {
            inner_cone_angle: 0.0,
            outer_cone_angle: std::f32::consts::FRAC_PI_4,
        }
    }
}

#[derive(Debug, Default, Deserialize)]
#[serde(default)]
pub struct SceneNodes {
    pub nodes: Vec<usize>,
    pub extras: Value,
}

#[derive(Debug, Default, Deserialize)]
#[serde(default)]
pub struct Node {
    pub name: Option<Name>,
    pub children: Vec<usize>,
    pub mesh: Option<usize>,
    pub camera: Option<usize>,
    pub skin: Option<usize>,
    #[serde(deserialize_with = "finite")]
    pub matrix: Option<[f64; 16]>,
    #[serde(deserialize_with = "finite")]
    pub translation: Option<[f64; 3]>,
    #[serde(deserialize_with = "finite")]
    pub rotation: Option<[f64; 4]>,
    #[serde(deserialize_with = "finite")]
    pub scale: Option<[f64; 3]>,
    #[serde(deserialize_with = "finite")]
    pub weights: Option<Vec<f32>>,
    pub extensions: NodeExtensions,
    pub extras: Value,
}

#[derive(Debug, Default, Deserialize)]
#[serde(default)]
pub struct NodeExtensions {
    #[serde(rename = "KHR_lights_punctual")]
    pub light: Option<NodeLight>,
    #[serde(rename = "EXT_mesh_gpu_instancing")]
    pub instancing: Option<Instancing>,
    #[serde(rename = "KHR_node_visibility")]
    pub visibility: Visibility,
}

#[derive(Debug, Deserialize)]
#[serde(default)]
pub struct Visibility {
    pub visible: bool,
}

impl Default for Visibility {
    fn default() -> Self {
        Self { visible: true }
    }
}

#[derive(Debug, Deserialize)]
pub struct Instancing {
    #[serde(default)]
    pub attributes: BTreeMap<String, usize>,
}

#[derive(Debug, Deserialize)]
pub struct NodeLight {
    pub light: usize,
}

#[derive(Debug, Deserialize)]
pub struct Mesh {
    pub name: Option<Name>,
    pub primitives: Vec<Primitive>,
    #[serde(default, deserialize_with = "finite")]
    pub weights: Option<Vec<f32>>,
}

#[derive(Debug, Deserialize)]
pub struct Primitive {
    pub attributes: BTreeMap<String, usize>,
    pub indices: Option<usize>,
    pub material: Option<usize>,
    #[serde(default = "triangles")]
    pub mode: u32,
    #[serde(default)]
    pub targets: Vec<BTreeMap<String, usize>>,
    #[serde(default)]
    pub extensions: PrimitiveExtensions,
}

#[derive(Debug, Default, Deserialize)]
#[serde(default)]
pub struct PrimitiveExtensions {
    #[serde(rename = "KHR_draco_mesh_compression")]
    pub draco: Option<Box<Draco>>,
}

#[derive(Debug, Deserialize)]
#[serde(rename_all = "camelCase")]
pub struct Draco {
    pub buffer_view: usize,
    /// Numbers of the attributes in the compressed data, by name.
    pub attributes: BTreeMap<String, u32>,
}

fn triangles() -> u32 {
    4
}

#[derive(Debug, Deserialize)]
#[serde(rename_all = "camelCase")]
pub struct Accessor {
    pub buffer_view: Option<usize>,
    #[serde(default)]
    pub byte_offset: u64,
    pub component_type: u32,
    #[serde(default)]
    pub normalized: bool,
    pub count: u64,
    #[serde(rename = "type")]
    pub kind: String,
    pub sparse: Option<Box<Sparse>>,
}

#[derive(Debug, Deserialize)]
pub struct Sparse {
    pub count: u64,
    pub indices: SparsePart,
    pub values: SparsePart,
}

#[derive(Debug, Deserialize)]
#[serde(rename_all = "camelCase")]
pub struct SparsePart {
    pub buffer_view: usize,
    #[serde(default)]
    pub byte_offset: u64,
    /// For indices only.
    pub component_type: Option<u32>,
}

#[derive(Debug, Deserialize)]
#[serde(rename_all = "camelCase")]
pub struct BufferView {
    pub buffer: usize,
    #[serde(default)]
    pub byte_offset: u64,
    pub byte_length: u64,
    pub byte_stride: Option<u64>,
    #[cfg(feature = "meshopt")]
    #[serde(default)]
    pub extensions: BufferViewExtensions,
}

#[cfg(feature = "meshopt")]
#[derive(Debug, Default, Deserialize)]
#[serde(default)]
pub struct BufferViewExtensions {
    #[serde(rename = "EXT_meshopt_compression")]
    pub meshopt: Option<Box<Meshopt>>,
}

#[cfg(feature = "meshopt")]
#[derive(Debug, Deserialize)]
#[serde(rename_all = "camelCase")]
pub struct Meshopt {
    pub buffer: usize,
    #[serde(default)]
    pub byte_offset: u64,
    pub byte_length: u64,
    pub byte_stride: u64,
    pub count: u64,
    pub mode: String,
    #[serde(default = "no_filter")]
    pub filter: String,
}

#[cfg(feature = "meshopt")]
fn no_filter() -> String {
    "NONE".to_owned()
}

#[derive(Debug, Deserialize)]
#[serde(rename_all = "camelCase")]
pub struct Buffer {
    pub byte_length: u64,
    pub uri: Option<String>,
    #[serde(default)]
    pub extensions: BufferExtensions,
}

#[derive(Debug, Default, Deserialize)]
#[serde(default)]
pub struct BufferExtensions {
    #[serde(rename = "EXT_meshopt_compression")]
    pub meshopt: MeshoptBuffer,
}

#[derive(Debug, Default, Deserialize)]
#[serde(default)]
pub struct MeshoptBuffer {
    /// The buffer has no content and only stands in for the decoded content of compressed buffer views.
    pub fallback: bool,
}

#[derive(Debug, Default, Deserialize)]
#[serde(default, rename_all = "camelCase")]
pub struct Texture {
    pub sampler: Option<usize>,
    pub source: Option<usize>,
    /// Names of images in other formats than PNG and JPEG.
    pub extensions: Others,
}

#[derive(Debug, Default, Deserialize)]
#[serde(default, rename_all = "camelCase")]
pub struct Image {
    pub uri: Option<String>,
    pub buffer_view: Option<usize>,
    pub name: Option<String>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(default, rename_all = "camelCase")]
pub struct Sampler {
    pub mag_filter: Option<u32>,
    pub min_filter: Option<u32>,
    pub wrap_s: Option<u32>,
    pub wrap_t: Option<u32>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(default)]
pub struct Camera {
    pub name: Option<Name>,
    pub perspective: Option<Perspective>,
    pub orthographic: Option<Orthographic>,
    pub extras: Value,
}

#[derive(Debug, Deserialize)]
pub struct Perspective {
    /// Vertical field of view (rad).
    #[serde(deserialize_with = "finite")]
    pub yfov: f32,
}

#[derive(Debug, Deserialize)]
pub struct Orthographic {
    /// Half the height of the visible volume.
    #[serde(deserialize_with = "finite")]
    pub ymag: f32,
}

#[derive(Debug, Deserialize)]
#[serde(rename_all = "camelCase")]
pub struct Skin {
    pub inverse_bind_matrices: Option<usize>,
    pub joints: Vec<usize>,
}

#[derive(Debug, Deserialize)]
pub struct Animation {
    pub name: Option<String>,
    pub channels: Vec<Channel>,
    pub samplers: Vec<AnimationSampler>,
}

#[derive(Debug, Deserialize)]
pub struct Channel {
    pub sampler: usize,
    pub target: Target,
}

#[derive(Debug, Deserialize)]
pub struct Target {
    pub node: Option<usize>,
    pub path: String,
}

#[derive(Debug, Deserialize)]
pub struct AnimationSampler {
    pub input: usize,
    pub output: usize,
    #[serde(default = "linear")]
    pub interpolation: String,
}

fn linear() -> String {
    "LINEAR".to_owned()
}
