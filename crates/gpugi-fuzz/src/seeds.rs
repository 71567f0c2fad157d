//! Undamaged files, which use as many features of their format as they can.

use std::io::Cursor;
use std::sync::Arc;

use base64::Engine;
use exr::prelude::{
    Blocks, Compression, Encoding, Image as ExrImage, Layer, LayerAttributes, LineOrder,
    SpecificChannels, Vec2, WritableImage,
};
use gpugi::bake::{Checkpoint, LightState, ObscuranceState, PrecomputedState};
use gpugi_scene::builtin::builtin;
use gpugi_scene::export::{
    BakedPage, TransferFormat, export_bake, export_panes, export_scene, export_transfer,
};
use gpugi_scene::image::{HalfTexture, save_ktx2};
use gpugi_scene::{
    Atlas, AtlasOptions, DensityGrid, LightPathPanes, Medium, Scene, SurfacePlace, TransferVectors,
};
use half::f16;
use image::{DynamicImage, ImageFormat, Rgb, Rgb32FImage, RgbImage, RgbaImage};
use serde_json::{Value, json};

use crate::formats::checkpoint_key;
use crate::mutate::{Case, glb as container};

fn one(name: &str, bytes: Vec<u8>) -> Case {
    vec![(name.to_owned(), bytes)]
}

/// The scene of checkpoints and bakes.
pub fn room() -> Scene {
    builtin("cornell", 1).expect("a built-in scene")
}

fn atlas(scene: &Scene) -> Atlas {
    let options = AtlasOptions {
        size: 64,
        ..AtlasOptions::default()
    };
    Atlas::new(scene, &options).expect("an atlas")
}

/// A document that uses every part of the importer, and its buffer.
fn document() -> (Value, Vec<u8>) {
    let mut binary = Vec::new();
    let mut views = Vec::new();
    let mut accessors = Vec::new();
    let mut add = |kind: &str, component: u32, count: usize, bytes: Vec<u8>| {
        let offset = binary.len();
        let length = bytes.len();
        binary.extend(bytes);
        binary.resize(binary.len().next_multiple_of(4), 0);
        views.push(json!({ "buffer": 0, "byteOffset": offset, "byteLength": length }));
        if count > 0 {
            accessors.push(json!({
                "bufferView": views.len() - 1, "componentType": component, "count": count, "type": kind,
            }));
        }
        (views.len() - 1, accessors.len().saturating_sub(1))
    };
    let floats = |values: &[f32]| {
        values
            .iter()
            .flat_map(|value| value.to_le_bytes())
            .collect::<Vec<u8>>()
    };
    let corners = [0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 1.0, 1.0, 0.2];
    let (_, positions) = add("VEC3", 5126, 4, floats(&corners));
    let (_, normals) = add("VEC3", 5126, 4, floats(&[0.0, 0.0, 1.0].repeat(4)));
    let (_, uvs) = add(
        "VEC2",
        5126,
        4,
        floats(&[0.0, 0.0, 1.0, 0.0, 0.0, 1.0, 1.0, 1.0]),
    );
    let (_, tangents) = add("VEC4", 5126, 4, floats(&[1.0, 0.0, 0.0, 1.0].repeat(4)));
    let (_, colors) = add("VEC4", 5121, 4, vec![200; 16]);
    let (_, indices) = add(
        "SCALAR",
        5123,
        6,
        [0_u16, 1, 2, 2, 1, 3].map(u16::to_le_bytes).concat(),
    );
    let (_, joints) = add("VEC4", 5121, 4, [0, 1, 0, 0].repeat(4));
    let (_, weights) = add("VEC4", 5126, 4, floats(&[0.5, 0.5, 0.0, 0.0].repeat(4)));
    let (_, offsets) = add("VEC3", 5126, 4, floats(&[0.1; 12]));
    let (_, matrices) = add(
        "MAT4",
        5126,
        2,
        floats(&glam::Mat4::IDENTITY.to_cols_array().repeat(2)),
    );
    let (_, times) = add("SCALAR", 5126, 2, floats(&[0.0, 1.0]));
    let (_, moves) = add("VEC3", 5126, 2, floats(&[0.0, 0.0, 0.0, 1.0, 2.0, 3.0]));
    let (_, turns) = add("VEC4", 5126, 6, floats(&[0.0, 0.0, 0.0, 1.0].repeat(6)));
    let (_, shares) = add("SCALAR", 5126, 2, floats(&[0.0, 1.0]));
    let (_, places) = add(
        "VEC3",
        5126,
        3,
        floats(&[0.0, 0.0, 0.0, 2.0, 0.0, 0.0, 4.0, 0.0, 0.0]),
    );
    let (picture, _) = add("", 0, 0, encoded(small(), ImageFormat::Png));
    let (photo, _) = add("", 0, 0, encoded(small(), ImageFormat::Jpeg));
    let (numbers, _) = add("", 0, 0, vec![1, 0, 0, 0]);
    let (values, _) = add("", 0, 0, floats(&[1.0, 0.0, 0.5]));
    accessors[positions]["sparse"] = json!({
        "count": 1, "indices": { "bufferView": numbers, "componentType": 5121 }, "values": { "bufferView": values },
    });
    accessors[colors]["normalized"] = json!(true);
    let document = json!({
        "asset": { "version": "2.0" },
        "extensionsUsed": ["KHR_lights_punctual", "EXT_mesh_gpu_instancing", "KHR_texture_transform"],
        "scene": 0,
        "scenes": [{ "nodes": [0, 2, 3, 4, 5] }],
        "nodes": [
            { "name": "bent", "mesh": 0, "skin": 0, "children": [1], "weights": [0.5] },
            { "rotation": [0, 0, 0, 1], "translation": [0, 1, 0], "scale": [1, 2, 1] },
            { "name": "camera", "camera": 0, "extensions": { "KHR_lights_punctual": { "light": 0 } } },
            { "mesh": 1, "extensions": { "EXT_mesh_gpu_instancing": { "attributes": { "TRANSLATION": places } } } },
            { "mesh": 1, "matrix": [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 3, 1] },
            { "camera": 1, "extensions": { "KHR_lights_punctual": { "light": 1 } } },
        ],
        "meshes": [
            { "name": "soft", "primitives": [{
                "attributes": {
                    "POSITION": positions, "NORMAL": normals, "TEXCOORD_0": uvs, "TANGENT": tangents,
                    "JOINTS_0": joints, "WEIGHTS_0": weights,
                },
                "indices": indices, "material": 0, "targets": [{ "POSITION": offsets, "NORMAL": offsets }],
            }] },
            { "primitives": [
                {
                    "attributes": { "POSITION": positions, "TEXCOORD_0": uvs, "COLOR_0": colors },
                    "material": 1, "mode": 5,
                },
                { "attributes": { "POSITION": positions, "TEXCOORD_0": uvs }, "indices": indices, "material": 2 },
                { "attributes": { "POSITION": positions }, "mode": 6 },
            ] },
        ],
        "skins": [{ "joints": [1, 0], "inverseBindMatrices": matrices }],
        "animations": [{
            "channels": [
                { "sampler": 0, "target": { "node": 1, "path": "translation" } },
                { "sampler": 1, "target": { "node": 1, "path": "rotation" } },
                { "sampler": 2, "target": { "node": 0, "path": "weights" } },
            ],
            "samplers": [
                { "input": times, "output": moves },
                { "input": times, "output": turns, "interpolation": "CUBICSPLINE" },
                { "input": times, "output": shares, "interpolation": "STEP" },
            ],
        }],
        "cameras": [
            { "type": "perspective", "perspective": { "yfov": 0.8, "znear": 0.1 } },
            { "type": "orthographic", "orthographic": { "xmag": 2, "ymag": 2, "znear": 0.1, "zfar": 10 } },
        ],
        "extensions": { "KHR_lights_punctual": { "lights": [
            { "type": "spot", "intensity": 5, "spot": { "innerConeAngle": 0.2, "outerConeAngle": 0.5 }, "range": 9 },
            { "type": "directional", "color": [1, 0.5, 0.2], "extras": { "gpugi": { "radius": 0.01 } } },
        ] } },
        "materials": [
            {
                "name": "glass", "normalTexture": { "index": 0, "scale": 0.5 }, "emissiveFactor": [1, 0, 0],
                "pbrMetallicRoughness": {
                    "baseColorTexture": { "index": 1 }, "roughnessFactor": 0.1, "metallicFactor": 0,
                },
                "extensions": {
                    "KHR_materials_transmission": { "transmissionFactor": 1 }, "KHR_materials_ior": { "ior": 1.4 },
                    "KHR_materials_volume": {
                        "thicknessFactor": 1, "attenuationDistance": 2, "attenuationColor": [1, 0.5, 0.5],
                    },
                    "KHR_materials_emissive_strength": { "emissiveStrength": 4 },
                    "KHR_materials_specular": { "specularFactor": 0.5, "specularColorFactor": [1, 2, 1] },
                },
            },
            {
                "alphaMode": "MASK", "alphaCutoff": 0.3, "doubleSided": true,
                "extensions": { "KHR_materials_pbrSpecularGlossiness": {
                    "diffuseTexture": {
                        "index": 0, "extensions": { "KHR_texture_transform": { "scale": [2, 2], "rotation": 1 } },
                    },
                    "specularGlossinessTexture": { "index": 0 }, "glossinessFactor": 0.7,
                } },
            },
            { "extensions": { "KHR_materials_diffuse_transmission": {
                "diffuseTransmissionFactor": 0.5, "diffuseTransmissionTexture": { "index": 0 },
                "diffuseTransmissionColorFactor": [1, 0.5, 0], "diffuseTransmissionColorTexture": { "index": 1 },
            } } },
            { "extras": { "gpugi": { "phong": { "kd": [0.8, 0, 0], "ks": [0.1, 0.5, 0.1], "shininess": 30 } } } },
            { "extras": { "gpugi": { "conductor": { "n": [0.2, 0.9, 1.1], "k": [3.9, 2.4, 2.2] } } } },
        ],
        "textures": [{ "source": 0, "sampler": 0 }, { "source": 1 }],
        "samplers": [{ "magFilter": 9728, "minFilter": 9987, "wrapS": 33071, "wrapT": 33648 }],
        "images": [
            { "bufferView": picture, "mimeType": "image/png" }, { "bufferView": photo, "mimeType": "image/jpeg" },
        ],
        "accessors": accessors,
        "bufferViews": views,
        "buffers": [{ "byteLength": binary.len() }],
    });
    (document, binary)
}

pub fn glb() -> Vec<Case> {
    let (document, binary) = document();
    let built_in = export_scene(&room()).expect("a file").glb;
    let mut cloud = builtin("cloud", 1).expect("a built-in scene");
    cloud.media[0].density = Some(Arc::new(DensityGrid {
        size: [2; 3],
        values: vec![0.5; 8],
    }));
    cloud.media.push(Medium {
        world_from_box: None,
        density: None,
        ..cloud.media[0].clone()
    });
    let cloud = export_scene(&cloud).expect("a file").glb;
    vec![
        one("a.glb", cloud),
        one("a.glb", container(document.to_string().as_bytes(), &binary)),
        one("a.glb", built_in),
    ]
}

pub fn gltf() -> Vec<Case> {
    let (mut document, binary) = document();
    document["buffers"][0]["uri"] = json!("a.bin");
    document["images"][0] = json!({ "uri": "a.png" });
    let beside = vec![
        ("a.gltf".to_owned(), document.to_string().into_bytes()),
        ("a.bin".to_owned(), binary),
        ("a.png".to_owned(), encoded(small(), ImageFormat::Png)),
    ];
    let triangle = json!({
        "asset": { "version": "2.0" },
        "nodes": [{ "mesh": 0 }],
        "meshes": [{ "primitives": [{ "attributes": { "POSITION": 0 } }] }],
        "accessors": [{ "bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3" }],
        "bufferViews": [{ "buffer": 0, "byteLength": 36 }],
        "buffers": [{
            "byteLength": 36,
            "uri": "data:application/octet-stream;base64,AAAAAAAAAAAAAAAAAACAPwAAAAAAAAAAAAAAAAAAgD8AAAAA",
        }],
    });
    vec![beside, one("a.gltf", triangle.to_string().into_bytes())]
}

pub fn bake() -> Vec<Case> {
    let scene = room();
    let atlas = atlas(&scene);
    let texels = (atlas.size * atlas.size) as usize;
    let page = BakedPage {
        obscurance: Some(vec![0.5; texels]),
        ..BakedPage::default()
    };
    let pages = vec![page; atlas.pages as usize];
    let baked = export_bake(None, &scene, &atlas, &pages).expect("a file");
    let mut cases = glb();
    cases.push(one("a.glb", baked.glb));
    cases
}

/// Files with transfer vectors, in both formats.
pub fn transfer() -> Vec<Case> {
    let scene = room();
    let atlas = atlas(&scene);
    let texels = (atlas.size * atlas.size * atlas.pages) as usize;
    let vectors = TransferVectors {
        order: 2,
        bounces: 1,
        atlas: atlas.into(),
        coefficients: vec![[f16::ONE; 4]; 4 * texels],
        geometry: [0; 32],
    };
    [TransferFormat::Half, TransferFormat::Byte]
        .map(|format| {
            let exported = export_transfer(None, &scene, &vectors, format);
            one("a.glb", exported.expect("a file").glb)
        })
        .into()
}

/// A file with two panes of four points.
pub fn panes() -> Vec<Case> {
    let scene = room();
    let atlas = atlas(&scene);
    let texels = (atlas.size * atlas.size * atlas.pages) as usize;
    let point = SurfacePlace {
        instance: 0,
        triangle: 0,
        barycentrics: [0.25; 2],
    };
    let panes = LightPathPanes {
        atlas: atlas.into(),
        depth: 1,
        entries: vec![point; 2],
        samples: vec![point; 2],
        firsts: vec![0, 1, 2],
        first_samples: vec![0, 0, 2],
        panes: vec![1 << 30; 2 * texels],
        geometry: [0; 32],
        materials: [0; 32],
    };
    let exported = export_panes(None, &scene, &panes).expect("a file");
    vec![one("a.glb", exported.glb)]
}

pub fn obj() -> Vec<Case> {
    let scene = "# a house
mtllib a.mtl
v 0 0 0
v 1 0 0
v 1 1 0
v 0 1 0
v 0.5 0.5 1 # a tip
vt 0 0
vt 1 0
vt 1 1
vn 0 0 1
o floor
usemtl plain
f 1/1/1 2/2/1 3/3/1 4
g roof left
usemtl shiny
f 1 2 5
f -4//1 -3//1 -1//1
usemtl metal
f 3 \\
4 5
s off
usemtl nowhere
f 4 1 5
";
    let library = "newmtl plain
Kd 0.8 0.1 0
Ks 0 0.5 0
Ns 30
map_Kd a.png
disp -mm 0.5 2 -bm 0.01 a.png
newmtl shiny
Kd 0.9
Ke 1 2 3
map_d -s 2 2 a.png
norm -bm 0.5 a.png
d 0.5
newmtl metal
map_Bump -clamp on -bm 0.5 a.png
Pr 0.2
Pm 1
Ni 1.4
illum 2
Tr 0.1
";
    vec![vec![
        ("a.obj".to_owned(), scene.into()),
        ("a.mtl".to_owned(), library.into()),
        ("a.png".to_owned(), encoded(small(), ImageFormat::Png)),
    ]]
}

pub fn ply() -> Vec<Case> {
    let header = |format: &str| {
        format!(
            "ply\nformat {format} 1.0\ncomment a tip\nelement vertex 4\n\
             property float x\nproperty float y\nproperty float z\n\
             property uchar red\nproperty uchar green\nproperty uchar blue\nelement face 3\n\
             property list uchar int vertex_indices\nend_header\n"
        )
    };
    let corners = [
        [0.0_f32, 0.0, 0.0],
        [1.0, 0.0, 0.0],
        [0.0, 1.0, 0.0],
        [0.0, 0.0, 1.0],
    ];
    let faces = [&[0, 1, 2][..], &[0, 1, 3], &[0, 1, 2, 3]];
    let mut text = header("ascii");
    let mut little = header("binary_little_endian").into_bytes();
    let mut big = header("binary_big_endian").into_bytes();
    for [x, y, z] in corners {
        text += &format!("{x} {y} {z} 255 128 0\n");
        for value in [x, y, z] {
            little.extend(value.to_le_bytes());
            big.extend(value.to_be_bytes());
        }
        little.extend([255, 128, 0]);
        big.extend([255, 128, 0]);
    }
    for face in faces {
        text += &format!("{}", face.len());
        little.push(face.len() as u8);
        big.push(face.len() as u8);
        for &index in face {
            text += &format!(" {index}");
            little.extend(i32::to_le_bytes(index));
            big.extend(i32::to_be_bytes(index));
        }
        text.push('\n');
    }
    vec![
        one("a.ply", text.into()),
        one("b.ply", little),
        one("c.ply", big),
    ]
}

fn small() -> DynamicImage {
    RgbaImage::from_fn(5, 3, |x, y| {
        image::Rgba([x as u8 * 50, y as u8 * 80, 7, 255 - x as u8])
    })
    .into()
}

fn encoded(image: DynamicImage, format: ImageFormat) -> Vec<u8> {
    let image = match format {
        ImageFormat::Jpeg => image.into_rgb8().into(),
        _ => image,
    };
    let mut bytes = Cursor::new(Vec::new());
    image.write_to(&mut bytes, format).expect("memory");
    bytes.into_inner()
}

pub fn png() -> Vec<Case> {
    let grey = DynamicImage::from(image::GrayImage::from_fn(9, 9, |x, y| {
        image::Luma([(x * y) as u8])
    }));
    let deep = DynamicImage::ImageRgb16(image::ImageBuffer::from_fn(4, 4, |x, y| {
        Rgb([x as u16 * 9999, y as u16, 3])
    }));
    [small(), grey, deep]
        .map(|image| one("a.png", encoded(image, ImageFormat::Png)))
        .into()
}

pub fn jpeg() -> Vec<Case> {
    let large = RgbImage::from_fn(40, 24, |x, y| {
        Rgb([(x * 6) as u8, (y * 9) as u8, (x * y) as u8])
    });
    let grey = image::GrayImage::from_fn(17, 17, |x, y| image::Luma([(x * y) as u8]));
    [small(), large.into(), grey.into()]
        .map(|image| one("a.jpg", encoded(image, ImageFormat::Jpeg)))
        .into()
}

fn radiance() -> Rgb32FImage {
    Rgb32FImage::from_fn(40, 20, |x, y| Rgb([x as f32 / 8.0, y as f32 * 2.0, 0.25]))
}

pub fn hdr() -> Vec<Case> {
    let flat = Rgb32FImage::from_pixel(4, 4, Rgb([1.0, 2.0, 3.0]));
    [radiance(), flat]
        .map(|image| one("a.hdr", encoded(image.into(), ImageFormat::Hdr)))
        .into()
}

/// Every compression that OpenEXR files have.
pub const EXR_COMPRESSIONS: [Compression; 10] = [
    Compression::Uncompressed,
    Compression::RLE,
    Compression::ZIP1,
    Compression::ZIP16,
    Compression::PIZ,
    Compression::PXR24,
    Compression::B44,
    Compression::B44A,
    Compression::DWAA(None),
    Compression::DWAB(None),
];

pub fn exr() -> Vec<Case> {
    let mut cases = Vec::new();
    for compression in EXR_COMPRESSIONS {
        for blocks in [Blocks::ScanLines, Blocks::Tiles(Vec2(16, 8))] {
            for is_half in [false, true] {
                let bytes = exr_file((40, 20), compression, blocks, is_half, gradient);
                cases.push(one("a.exr", bytes));
            }
        }
    }
    cases
}

/// An OpenEXR file of whole or half floats. `color`: that of each texel.
pub fn exr_file(
    size: (usize, usize),
    compression: Compression,
    blocks: Blocks,
    is_half: bool,
    color: impl Fn(Vec2<usize>) -> (f32, f32, f32) + Sync,
) -> Vec<u8> {
    let encoding = Encoding {
        compression,
        blocks,
        line_order: LineOrder::Increasing,
    };
    let mut bytes = Cursor::new(Vec::new());
    let attributes = LayerAttributes::named("all");
    let written = if is_half {
        let channels = SpecificChannels::rgb(|at| {
            let (r, g, b) = color(at);
            let half = half::f16::from_f32;
            (half(r), half(g), half(b))
        });
        let layer = Layer::new(size, attributes, encoding, channels);
        let image = ExrImage::from_layer(layer);
        image.write().non_parallel().to_buffered(&mut bytes)
    } else {
        let channels = SpecificChannels::rgb(color);
        let layer = Layer::new(size, attributes, encoding, channels);
        let image = ExrImage::from_layer(layer);
        image.write().non_parallel().to_buffered(&mut bytes)
    };
    written.expect("memory");
    bytes.into_inner()
}

fn gradient(at: Vec2<usize>) -> (f32, f32, f32) {
    (at.x() as f32 / 8.0, at.y() as f32, 0.25)
}

pub fn ktx2() -> Vec<Case> {
    let texel = [0.0, 0.5, 1.0, 1.0].map(half::f16::from_f32);
    let flat = HalfTexture {
        size: [4, 4],
        depth: 1,
        faces: 1,
        levels: vec![vec![texel; 16], vec![texel; 4], vec![texel; 1]],
    };
    let solid = HalfTexture {
        size: [4, 2],
        depth: 3,
        faces: 1,
        levels: vec![vec![texel; 24]],
    };
    let folder = std::env::temp_dir();
    let mut cases = Vec::new();
    for texture in [flat, solid] {
        let path = folder.join(format!("gpugi-fuzz-{}.ktx2", std::process::id()));
        save_ktx2(&path, &texture).expect("a file");
        cases.push(one("a.ktx2", std::fs::read(&path).expect("a file")));
        std::fs::remove_file(&path).ok();
    }
    // The first one in 8 bits: VK_FORMAT_R8G8B8A8_UNORM, of which half as many bytes are enough.
    let mut bytes = cases[0][0].1.clone();
    bytes[12..16].copy_from_slice(&37_u32.to_le_bytes());
    cases.push(one("a.ktx2", bytes));
    cases
}

pub fn basis() -> Vec<Case> {
    let texts = [
        include_str!("../../gpugi-scene/tests/scene/basis/etc1s.base64"),
        include_str!("../../gpugi-scene/tests/scene/basis/uastc.base64"),
    ];
    let file = |text: &str| {
        let bytes = base64::engine::general_purpose::STANDARD.decode(text.replace('\n', ""));
        one("image.ktx2", bytes.expect("base64"))
    };
    texts.map(file).to_vec()
}

/// Without and with an extended header.
pub fn webp() -> Vec<Case> {
    let image = DynamicImage::ImageRgba8(small().into_rgba8());
    let [width, height] = [image.width(), image.height()].map(|side| side - 1);
    let plain = encoded(image, ImageFormat::WebP);
    let mut header = vec![0x10, 0, 0, 0];
    header.extend(&width.to_le_bytes()[..3]);
    header.extend(&height.to_le_bytes()[..3]);
    let chunks = [b"VP8X", &10_u32.to_le_bytes()[..], &header, &plain[12..]].concat();
    let length = (4 + chunks.len() as u32).to_le_bytes();
    let extended = [b"RIFF", &length[..], b"WEBP", &chunks].concat();
    vec![one("a.webp", plain), one("b.webp", extended)]
}

/// A triangle by each of Draco's methods.
pub fn draco() -> Vec<Case> {
    let file = |method: i32| {
        let mut mesh = draco_core::Mesh::new();
        let mut positions = draco_core::PointAttribute::new();
        let kind = draco_core::GeometryAttributeType::Position;
        positions.init(kind, 3, draco_core::DataType::Float32, false, 4);
        let corners = [
            0.0_f32, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 1.0, 1.0, 0.5,
        ];
        positions
            .buffer_mut()
            .write(0, bytemuck::cast_slice(&corners));
        mesh.add_attribute(positions);
        mesh.set_num_faces(2);
        for (number, face) in [[0, 1, 2], [2, 1, 3]].into_iter().enumerate() {
            let face = face.map(draco_core::PointIndex);
            mesh.set_face(draco_core::FaceIndex(number as u32), face);
        }
        let mut encoder = draco_core::MeshEncoder::new();
        encoder.set_mesh(mesh);
        let mut options = draco_core::EncoderOptions::new();
        options.set_encoding_method(method);
        let mut packed = draco_core::EncoderBuffer::new();
        encoder.encode(&options, &mut packed).expect("a mesh");
        let packed = packed.data();
        let json = json!({
            "asset": { "version": "2.0" }, "nodes": [{ "mesh": 0 }],
            "extensionsRequired": ["KHR_draco_mesh_compression"],
            "buffers": [{ "byteLength": packed.len(), "uri": "packed.bin" }],
            "bufferViews": [{ "buffer": 0, "byteLength": packed.len() }],
            "accessors": [
                { "componentType": 5126, "count": 4, "type": "VEC3" },
                { "componentType": 5123, "count": 6, "type": "SCALAR" },
            ],
            "meshes": [{ "primitives": [{ "attributes": { "POSITION": 0 }, "indices": 1, "extensions": {
                "KHR_draco_mesh_compression": { "bufferView": 0, "attributes": { "POSITION": 0 } },
            } }] }],
        });
        let json = json.to_string().into_bytes();
        vec![
            ("scene.gltf".to_owned(), json),
            ("packed.bin".to_owned(), packed.to_vec()),
        ]
    };
    [0, 1].map(file).to_vec()
}

/// A cloud of one leaf in the layout of NanoVDB 32, in floats and in bytes.
pub fn nvdb() -> Vec<Case> {
    const ROOT: usize = 672 + 64;
    const UPPER: usize = ROOT + 64 + 32;
    const LOWER: usize = UPPER + 270_400;
    const LEAF: usize = LOWER + 33_856;
    let grid = |value_type: u32| {
        let mut grid = vec![0; LEAF + 96 + 4 * 512];
        let mut put = |at: usize, value: &[u8]| grid[at..at + value.len()].copy_from_slice(value);
        put(0, b"NanoVDB1");
        put(16, &(32_u32 << 21).to_le_bytes());
        put(40, b"density");
        put(632, &[2]);
        put(636, &value_type.to_le_bytes());
        // The root with its box and a tile, an upper node, a lower one and the leaf, each with the way to the next.
        put(672 + 24, &[64]);
        put(ROOT + 12, &[7, 0, 0, 0, 7, 0, 0, 0, 7, 0, 0, 0, 1]);
        put(ROOT + 64 + 8, &[64 + 32]);
        put(UPPER + 4128, &[1]);
        put(UPPER + 8256, &(LOWER - UPPER).to_le_bytes());
        put(LOWER + 544, &[1]);
        put(LOWER + 1088, &(LEAF - LOWER).to_le_bytes());
        put(LEAF + 84, &0.1_f32.to_le_bytes());
        for voxel in 0..512 {
            put(LEAF + 96 + 4 * voxel, &(voxel as f32).to_le_bytes());
        }
        grid
    };
    let document = json!({
        "asset": { "version": "2.0" },
        "scenes": [{ "nodes": [0] }],
        "nodes": [{ "extras": { "gpugi": { "medium": { "extinction": [1, 1, 1], "density": "a.nvdb" } } } }],
    });
    let case = |value_type| {
        vec![
            ("a.gltf".to_owned(), document.to_string().into_bytes()),
            ("a.nvdb".to_owned(), grid(value_type)),
        ]
    };
    vec![case(1), case(14)]
}

pub fn checkpoint() -> Vec<Case> {
    let begun = Checkpoint {
        atlas: atlas(&room()),
        obscurances: Some(ObscuranceState::default()),
        light: Some(LightState::default()),
        precomputed: Some(PrecomputedState::default()),
    };
    let empty = Checkpoint {
        atlas: begun.atlas.clone(),
        ..Checkpoint::default()
    };
    [begun, empty]
        .map(|checkpoint| one("a.checkpoint", checkpoint.to_bytes(&checkpoint_key())))
        .into()
}

#[cfg(test)]
mod tests {
    use gpugi_scene::image::decode_radiance;
    use gpugi_scene::{Limits, import};

    use super::*;
    use crate::formats::{ALL, Files};

    /// A seed that is refused would lead nowhere.
    #[test]
    fn seeds_are_read() {
        for case in [glb(), gltf(), bake(), transfer(), panes(), obj(), ply()].concat() {
            let (name, bytes) = &case[0];
            let scene = import(name, bytes, &Files(&case), &Limits::default());
            let scene = scene.unwrap_or_else(|error| panic!("{error}"));
            assert!(!scene.instances.is_empty(), "{name}");
        }
        let pictures = [png(), jpeg(), hdr(), exr()].concat();
        for case in &pictures {
            let (name, bytes) = &case[0];
            let image = decode_radiance(name, bytes, &Limits::default());
            image.unwrap_or_else(|error| panic!("{error}"));
        }
    }

    #[test]
    fn seeds_do_not_fail() {
        for format in &ALL {
            for case in (format.seeds)() {
                let outcome = (format.run)(&case);
                assert_eq!(outcome.failure, None, "{}", format.name);
            }
        }
    }
}
