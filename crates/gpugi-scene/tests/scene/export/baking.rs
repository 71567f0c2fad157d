//! A bake without a baker: atlases and pages that tests can recognise, and tools that take exported files apart.

use glam::{Vec2, Vec3, vec2};
use gpugi_scene::atlas::{Atlas, InstanceUvs};
use gpugi_scene::export::{BakedPage, ExportError, Exported, Original, export_bake};
use gpugi_scene::{Limits, Resolver, Scene, import};
use serde_json::Value;

use crate::builder::{File, Files};

/// Texels per side of the pages here.
pub const SIZE: u32 = 4;

/// An atlas in which no two corners of the scene have the same coordinates, so that every vertex is split.
pub fn shredded(scene: &Scene) -> Atlas {
    let mut number = 0_u32;
    atlas(scene, |_, _| {
        number += 1;
        vec2((number % 128) as f32 / 128.0, (number / 128) as f32 / 128.0)
    })
}

/// An atlas in which each vertex of an instance has one pair of coordinates, so that no vertex is split.
pub fn whole(scene: &Scene) -> Atlas {
    atlas(scene, |instance, vertex| {
        vec2(instance as f32 / 64.0, vertex as f32 / 64.0)
    })
}

/// An atlas of one page. `uv`: the coordinates of a corner by instance and vertex, called once per corner.
pub fn atlas(scene: &Scene, mut uv: impl FnMut(usize, u32) -> Vec2) -> Atlas {
    let instances = scene.instances.iter().enumerate();
    let instances = instances
        .map(|(number, instance)| {
            let indices = &scene.meshes[instance.mesh].indices;
            Some(InstanceUvs {
                page: 0,
                corners: indices.iter().map(|&index| uv(number, index)).collect(),
                charts: vec![0; indices.len() / 3],
            })
        })
        .collect();
    Atlas {
        size: SIZE,
        pages: 1,
        instances,
        backs: Vec::new(),
    }
}

/// A page of obscurance 0.5.
pub fn obscured() -> BakedPage {
    BakedPage {
        obscurance: Some(vec![0.5; (SIZE * SIZE) as usize]),
        ..BakedPage::default()
    }
}

pub fn try_bake(
    bytes: &[u8],
    resolver: &dyn Resolver,
    scene: &Scene,
    atlas: &Atlas,
    page: BakedPage,
) -> Result<Exported, ExportError> {
    let original = Original {
        name: "test.glb",
        bytes,
        resolver,
        limits: Limits::default(),
    };
    export_bake(Some(original), scene, atlas, &[page])
}

/// Bakes `file`, a .glb, which must work without a warning.
#[track_caller]
pub fn bake(file: &File, scene: &Scene, atlas: &Atlas, page: BakedPage) -> Baked {
    let exported = try_bake(&file.glb(), &Files::default(), scene, atlas, page)
        .unwrap_or_else(|error| panic!("{error}"));
    assert_eq!(exported.warnings, [""; 0]);
    Baked::new(&exported.glb)
}

/// An exported file.
pub struct Baked {
    pub json: Value,
    pub binary: Vec<u8>,
    pub scene: Scene,
}

impl Baked {
    #[track_caller]
    pub fn new(glb: &[u8]) -> Self {
        keep(glb);
        let number = |at: usize| u32::from_le_bytes(glb[at..at + 4].try_into().unwrap()) as usize;
        assert_eq!(&glb[..4], b"glTF");
        assert_eq!(number(8), glb.len());
        let length = number(12);
        assert!(length.is_multiple_of(4));
        let binary = 20 + length + 8;
        let scene = import("baked.glb", glb, &Files::default(), &Limits::default());
        let json: Value = serde_json::from_slice(&glb[20..20 + length]).unwrap();
        for view in json["bufferViews"].as_array().into_iter().flatten() {
            let offset = view["byteOffset"].as_u64().unwrap_or(0);
            assert!(offset.is_multiple_of(4), "{view} is not aligned");
        }
        Self {
            json,
            binary: glb.get(binary..).unwrap_or_default().to_vec(),
            scene: scene.unwrap_or_else(|error| panic!("{error}")),
        }
    }

    /// The bytes of a view.
    pub fn view(&self, view: &Value) -> &[u8] {
        let view = &self.json["bufferViews"][view.as_u64().unwrap() as usize];
        let number = |member: &str| view[member].as_u64().unwrap_or(0) as usize;
        &self.binary[number("byteOffset")..][..number("byteLength")]
    }

    /// The elements, `size` bytes each, of an accessor that is not sparse.
    pub fn elements(&self, accessor: &Value, size: usize) -> Vec<Vec<u8>> {
        let accessor = &self.json["accessors"][accessor.as_u64().unwrap() as usize];
        assert!(accessor.get("sparse").is_none());
        let view = &accessor["bufferView"];
        let stride = &self.json["bufferViews"][view.as_u64().unwrap() as usize]["byteStride"];
        let stride = stride.as_u64().map_or(size, |stride| stride as usize);
        assert!(
            stride.is_multiple_of(4),
            "vertex attributes lie at multiples of 4 bytes"
        );
        let bytes = &self.view(view)[accessor["byteOffset"].as_u64().unwrap_or(0) as usize..];
        let count = accessor["count"].as_u64().unwrap() as usize;
        let element = |at: usize| bytes[at * stride..][..size].to_vec();
        (0..count).map(element).collect()
    }
}

/// Keeps exported files in the folder that `GPUGI_KEEP_EXPORTS` names, for the Khronos validator.
pub fn keep(glb: &[u8]) {
    if let Ok(folder) = std::env::var("GPUGI_KEEP_EXPORTS") {
        let test = std::thread::current()
            .name()
            .unwrap_or("test")
            .replace("::", "-");
        let number = glb
            .iter()
            .fold(0_u32, |sum, byte| sum.wrapping_mul(31) + u32::from(*byte));
        std::fs::write(format!("{folder}/{test}-{number:08x}.glb"), glb).unwrap();
    }
}

/// Every corner of every triangle of a scene: its position in world space, and its coordinates in UV set `set`.
fn corners(scene: &Scene, set: usize) -> Vec<(Vec3, Vec2)> {
    let corners = scene.instances.iter().flat_map(|instance| {
        let mesh = &scene.meshes[instance.mesh];
        let uvs = &mesh.uvs[set];
        mesh.indices.iter().map(move |&index| {
            let position = mesh.positions[index as usize];
            let uv = uvs.get(index as usize);
            let position = instance.world_from_mesh.transform_point3(position);
            (position, uv.copied().unwrap_or(Vec2::NAN))
        })
    });
    corners.collect()
}

/// Every corner of every triangle of a scene, in world space.
pub fn positions(scene: &Scene) -> Vec<Vec3> {
    let corners = corners(scene, 0).into_iter();
    corners.map(|(position, _)| position).collect()
}

/// Checks that the bake shows each triangle of the original in its place, with its atlas coordinates in UV set `set`.
#[track_caller]
pub fn assert_mapped(original: &Scene, atlas: &Atlas, baked: &Scene, set: usize) {
    let uvs = atlas.instances.iter().flatten();
    let uvs = uvs.flat_map(|uvs| uvs.corners.clone());
    let expected: Vec<(Vec3, Vec2)> = positions(original).into_iter().zip(uvs).collect();
    let found = corners(baked, set);
    assert_eq!(found.len(), expected.len());
    for (corner, (found, expected)) in found.into_iter().zip(expected).enumerate() {
        assert_eq!(found, expected, "corner {corner}");
    }
}

/// The scene of a baked file, or the error.
pub fn read(glb: &[u8]) -> Result<Scene, String> {
    import("baked.glb", glb, &Files::default(), &Limits::default())
        .map_err(|error| error.to_string())
}

/// The same file with other JSON.
pub fn edited(glb: &[u8], edit: impl FnOnce(&mut Value)) -> Vec<u8> {
    let length = u32::from_le_bytes(glb[12..16].try_into().unwrap()) as usize;
    let mut json: Value = serde_json::from_slice(&glb[20..20 + length]).unwrap();
    edit(&mut json);
    let mut text = serde_json::to_vec(&json).unwrap();
    text.resize(text.len().next_multiple_of(4), b' ');
    let mut file = [b"glTF", &2_u32.to_le_bytes()[..]].concat();
    let rest = &glb[20 + length..];
    file.extend(((20 + text.len() + rest.len()) as u32).to_le_bytes());
    file.extend((text.len() as u32).to_le_bytes());
    file.extend(b"JSON");
    file.extend(text);
    file.extend(rest);
    file
}
