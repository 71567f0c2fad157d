//! The formats, and what is done with a file of each.

use glam::Vec2;
use gpugi::bake::{Checkpoint, CheckpointKey};
use gpugi_scene::atlas::InstanceUvs;
use gpugi_scene::bvh::{BottomLevel, BvhInstance};
use gpugi_scene::export::{
    BakedPage, Changes, Original, export_bake, export_original, export_scene,
};
use gpugi_scene::image::{decode_color, decode_radiance};
use gpugi_scene::{Atlas, AtlasOptions, Limits, Resolver, Scene, import};

use crate::allocator::measured;
use crate::mutate::Case;
use crate::seeds;

/// Limits that keep a case short. The importer may take twice as much while it works.
const LIMITS: Limits = Limits {
    file_bytes: 1 << 20,
    image_side: 1024,
    image_bytes: 4 << 20,
    scene_bytes: 16 << 20,
    expansion: 1024,
    displaced_triangles: 10_000,
};
/// Memory that an import may take under these limits (bytes): twice what they allow, and copies of its files.
const MOST: usize = 2 * (20 << 20);
/// Scenes beyond this are not unwrapped or exported: both take long, and neither depends on more.
const MOST_TRIANGLES: u64 = 3000;
const MOST_INSTANCES: usize = 300;

/// A format: its name, its first files, and what is done with each.
pub struct Format {
    pub name: &'static str,
    pub seeds: fn() -> Vec<Case>,
    /// Reads a case.
    pub run: fn(&Case) -> Outcome,
}

/// What became of a case.
pub struct Outcome {
    /// Text that is the same for cases that took the same way: an error without its numbers, or sizes.
    pub signature: String,
    /// What is wrong with gpugi, if anything.
    pub failure: Option<String>,
}

/// All formats.
pub const ALL: [Format; 17] = [
    format("glb", seeds::glb, run_scene),
    format("gltf", seeds::gltf, run_scene),
    format("bake", seeds::bake, run_bake),
    format("transfer", seeds::transfer, run_scene),
    format("panes", seeds::panes, run_scene),
    format("obj", seeds::obj, run_scene),
    format("ply", seeds::ply, run_scene),
    format("png", seeds::png, run_image),
    format("jpeg", seeds::jpeg, run_image),
    format("hdr", seeds::hdr, run_image),
    format("exr", seeds::exr, run_image),
    format("ktx2", seeds::ktx2, run_image),
    format("basis", seeds::basis, run_image),
    format("webp", seeds::webp, run_image),
    format("draco", seeds::draco, run_scene),
    format("nvdb", seeds::nvdb, run_scene),
    format("checkpoint", seeds::checkpoint, run_checkpoint),
];

const fn format(name: &'static str, seeds: fn() -> Vec<Case>, run: fn(&Case) -> Outcome) -> Format {
    Format { name, seeds, run }
}

/// The files of a case.
pub struct Files<'a>(pub &'a Case);

impl Resolver for Files<'_> {
    fn read(&self, uri: &str) -> Result<Vec<u8>, String> {
        let found = self.0.iter().find(|(name, _)| name == uri);
        let (_, bytes) = found.ok_or("no such file")?;
        Ok(bytes.clone())
    }
}

/// Text without what differs between equal errors: digits, and what is quoted.
fn without_numbers(text: &str) -> String {
    let unquoted: Vec<&str> = text.split('"').step_by(2).collect();
    let mut plain = String::new();
    for character in unquoted.join("\"").chars() {
        let character = if character.is_ascii_digit() {
            '0'
        } else {
            character
        };
        if !(character == '0' && plain.ends_with('0')) {
            plain.push(character);
        }
    }
    plain.truncate(plain.floor_char_boundary(300));
    plain
}

/// Imports the first file under the limits.
fn imported(case: &Case) -> Result<Scene, Outcome> {
    let given: usize = case.iter().map(|(_, bytes)| bytes.len()).sum();
    let (name, bytes) = &case[0];
    let (scene, peak) = measured(|| import(name, bytes, &Files(case), &LIMITS));
    let signature = match &scene {
        Ok(scene) => sizes(scene),
        Err(error) => without_numbers(&error.to_string()),
    };
    if peak > MOST + 4 * given {
        return Err(Outcome {
            failure: Some(format!(
                "import takes more memory than its limits ({signature})"
            )),
            signature,
        });
    }
    scene.map_err(|error| {
        let message = error.to_string();
        Outcome {
            failure: (message.len() > 1000).then(|| "a message of more than 1000 bytes".to_owned()),
            signature,
        }
    })
}

fn sizes(scene: &Scene) -> String {
    let statistics = scene.statistics();
    let sizes = [
        statistics.meshes as u64,
        statistics.instances as u64,
        statistics.triangles,
        statistics.materials as u64,
        statistics.images as u64,
        statistics.cameras as u64,
        scene.lights.len() as u64,
        scene.warnings.len() as u64,
        u64::from(statistics.animated),
    ];
    // Halves of powers of two: close sizes take the same way.
    let warning = scene
        .warnings
        .last()
        .map_or_else(String::new, |text| without_numbers(text));
    format!("{:?} {warning}", sizes.map(|size| size.checked_ilog2()))
}

fn run_scene(case: &Case) -> Outcome {
    let mut scene = match imported(case) {
        Ok(scene) => scene,
        Err(outcome) => return outcome,
    };
    let mut signature = sizes(&scene);
    scene.pose(0.3);
    let used = use_scene(&scene, &mut signature);
    let failure = used.and_then(|()| convert(case, &mut signature)).err();
    Outcome { signature, failure }
}

/// Every change of a file that was imported.
const CHANGES: Changes = Changes {
    drops_lights: true,
    photometric: true,
    unpacks: true,
    prunes: true,
};

/// Converts a glTF file that was imported: the result is read, too.
fn convert(case: &Case, signature: &mut String) -> Result<(), String> {
    let (name, bytes) = &case[0];
    if !name.ends_with("gltf") && !name.ends_with("glb") {
        return Ok(());
    }
    let original = Original {
        name,
        bytes,
        resolver: &Files(case),
        limits: LIMITS,
    };
    let exported = export_original(&original);
    match exported.and_then(|exported| exported.changed(&CHANGES)) {
        Ok(exported) => read_again("converted.glb", &exported.glb),
        Err(error) => {
            signature.push_str(&without_numbers(&error.to_string()));
            Ok(())
        }
    }
}

/// Reads what was written.
fn read_again(name: &str, glb: &[u8]) -> Result<(), String> {
    let read = import(name, glb, &Files(&Vec::new()), &Limits::default());
    read.map(drop).map_err(|error| {
        let error = without_numbers(&error.to_string());
        format!("what was written is refused: {error}")
    })
}

/// Does with a scene what renders and bakes do. The error says what should not have happened.
fn use_scene(scene: &Scene, signature: &mut String) -> Result<(), String> {
    for mesh in &scene.meshes {
        mesh.check()
            .map_err(|reason| format!("a mesh that is none: {}", without_numbers(&reason)))?;
    }
    let triangles = scene.meshes.iter().map(|mesh| {
        let corners = mesh.indices.as_chunks::<3>().0.iter();
        corners
            .map(|triangle| triangle.map(|index| mesh.positions[index as usize]))
            .collect::<Vec<_>>()
    });
    let (bottom, _) = BottomLevel::new(triangles).map_err(|error| error.to_string())?;
    let spheres = scene.spheres().map_err(|(_, error)| error.to_string())?;
    let instances: Vec<BvhInstance> = (scene.instances.iter().zip(spheres))
        .map(|(instance, sphere)| BvhInstance {
            mesh: instance.mesh,
            world_from_mesh: instance.world_from_mesh,
            flags: 0,
            sphere,
        })
        .collect();
    bottom
        .top_level(&instances)
        .map_err(|error| error.to_string())?;
    if scene.statistics().triangles > MOST_TRIANGLES || scene.instances.len() > MOST_INSTANCES {
        return Ok(());
    }
    let options = AtlasOptions {
        size: 64,
        ..AtlasOptions::default()
    };
    match Atlas::new(scene, &options) {
        Ok(atlas) => atlas
            .check(scene)
            .map_err(|reason| format!("the atlas: {}", without_numbers(&reason)))?,
        Err(error) => signature.push_str(&without_numbers(&error.to_string())),
    }
    match export_scene(scene) {
        Ok(exported) => {
            let read = import(
                "exported.glb",
                &exported.glb,
                &Files(&Vec::new()),
                &Limits::default(),
            );
            let read = read.map_err(|error| {
                format!(
                    "its export is refused: {}",
                    without_numbers(&error.to_string())
                )
            })?;
            if read.statistics().triangles != scene.statistics().triangles {
                return Err("its export has other triangles".to_owned());
            }
        }
        Err(error) => signature.push_str(&without_numbers(&error.to_string())),
    }
    Ok(())
}

/// Reads a baked file, and bakes into it once more, with vertices split at every edge.
fn run_bake(case: &Case) -> Outcome {
    let scene = match imported(case) {
        Ok(scene) => scene,
        Err(outcome) => return outcome,
    };
    let mut signature = sizes(&scene);
    if scene.statistics().triangles > MOST_TRIANGLES || scene.instances.len() > MOST_INSTANCES {
        return Outcome {
            signature,
            failure: None,
        };
    }
    let instances = scene.instances.iter().map(|instance| {
        let corners = 0..scene.meshes[instance.mesh].indices.len();
        Some(InstanceUvs {
            corners: corners
                .map(|corner| Vec2::splat(corner as f32 % 8.0 / 8.0))
                .collect(),
            page: 0,
            charts: Vec::new(),
        })
    });
    let atlas = Atlas {
        size: 1,
        pages: 1,
        instances: instances.collect(),
        backs: Vec::new(),
    };
    let page = BakedPage {
        obscurance: Some(vec![0.5]),
        ..BakedPage::default()
    };
    let (name, bytes) = &case[0];
    let original = Original {
        name,
        bytes,
        resolver: &Files(case),
        limits: LIMITS,
    };
    let exported = export_bake(Some(original), &scene, &atlas, &[page]);
    let failure = match exported.and_then(|exported| exported.changed(&CHANGES)) {
        Ok(exported) => read_again("baked.glb", &exported.glb).err(),
        Err(error) => {
            signature.push_str(&without_numbers(&error.to_string()));
            None
        }
    };
    Outcome { signature, failure }
}

fn run_image(case: &Case) -> Outcome {
    let (name, bytes) = &case[0];
    let mut outcome = Outcome {
        signature: String::new(),
        failure: None,
    };
    for decode in [decode_color, decode_radiance] {
        let (image, peak) = measured(|| decode(name, bytes, &LIMITS));
        let signature = match image {
            Ok(image) => format!("{:?}", [image.width, image.height].map(u32::checked_ilog2)),
            Err(error) => without_numbers(&error.to_string()),
        };
        // Progressive JPEG has coefficients of 16 bits for each channel of each texel.
        let copies = if name.ends_with("jpg") { 4 } else { 2 };
        if peak > copies * LIMITS.image_bytes as usize + 4 * bytes.len() {
            let failure = format!("decoding takes more memory than its limits ({signature})");
            outcome.failure = Some(failure);
        }
        outcome.signature += &signature;
    }
    outcome
}

fn run_checkpoint(case: &Case) -> Outcome {
    let (_, bytes) = &case[0];
    let scene = seeds::room();
    let key = checkpoint_key();
    let (read, peak) = measured(|| Checkpoint::from_bytes(bytes, &key, &scene));
    let signature = match read {
        Ok(checkpoint) => format!(
            "{} {}",
            checkpoint.light.is_some(),
            checkpoint.obscurances.is_some()
        ),
        Err(error) => without_numbers(&error.to_string()),
    };
    let is_large = peak > 64 * bytes.len() + (8 << 20);
    Outcome {
        failure: is_large.then(|| "reading takes more memory than the file suggests".to_owned()),
        signature,
    }
}

/// The key of every checkpoint here.
pub fn checkpoint_key() -> CheckpointKey {
    CheckpointKey::new(&[0; 32], "fuzz")
}

#[cfg(test)]
mod tests {
    use exr::prelude::{Blocks, Vec2};

    use super::*;
    use crate::seeds::{EXR_COMPRESSIONS, exr_file};

    /// Side of an image of one block (texels).
    const SIDE: usize = 512;
    /// Tables that some decompressions allocate for each block, however small it is (bytes).
    const TABLES: usize = 2 << 20;

    /// In memory are the picture and one block, in six copies at most; less is refused.
    #[test]
    fn exr_takes_what_its_limit_says() {
        let noise = |at: Vec2<usize>| {
            let number = (at.x() * 7919 + at.y() * 104_729) % 1013;
            (number as f32, number as f32 * 0.01, 0.25)
        };
        for compression in EXR_COMPRESSIONS {
            for (is_half, texel) in [(false, 12), (true, 6)] {
                let blocks = Blocks::Tiles(Vec2(SIDE, SIDE));
                let bytes = exr_file((SIDE, SIDE), compression, blocks, is_half, noise);
                let enough = SIDE * SIDE * (16 + 6 * texel);
                let read = |image_bytes: usize| {
                    let limits = Limits {
                        image_bytes: image_bytes as u64,
                        ..Limits::default()
                    };
                    measured(|| decode_radiance("a.exr", &bytes, &limits))
                };
                let (image, peak) = read(enough);
                image.unwrap_or_else(|error| panic!("{compression}: {error}"));
                assert!(
                    peak < enough + TABLES,
                    "{compression}: {peak}, not {enough}"
                );
                let (image, peak) = read(enough - 1);
                let error = image.unwrap_err();
                assert!(error.reason.contains("--limits images"), "{error}");
                assert!(peak < 1 << 16, "{compression}: {peak}");
            }
        }
    }

    /// What many things share, and what is copied for each, takes no more than twice the limit.
    #[test]
    fn imports_take_what_their_limits_say() {
        let long = "x".repeat(200_000);
        let mut groups = format!("v 0 0 0\nv 1 0 0\nv 0 1 0\ng {long}\n");
        for part in 0..4000 {
            groups += &format!("usemtl {part}\nf 1 2 3\n");
        }
        let scene = |change: &dyn Fn(&mut serde_json::Value)| {
            let mut document = serde_json::json!({
                "asset": { "version": "2.0" },
                "nodes": [{ "mesh": 0 }],
                "meshes": [{
                    "name": long,
                    "primitives": [{ "attributes": { "POSITION": 0, "NORMAL": 0 } }],
                }],
                "accessors": [{ "componentType": 5126, "count": 900, "type": "VEC3" }],
            });
            change(&mut document);
            document.to_string()
        };
        let copies = |value: &serde_json::Value, count| serde_json::json!(vec![value; count]);
        let files = [
            ("a.obj", groups),
            (
                "nodes.gltf",
                scene(&|document| {
                    document["nodes"] = copies(&document["nodes"][0], 4000);
                }),
            ),
            (
                "primitives.gltf",
                scene(&|document| {
                    let primitives = copies(&document["meshes"][0]["primitives"][0], 500);
                    document["meshes"][0]["primitives"] = primitives;
                }),
            ),
            (
                "targets.gltf",
                scene(&|document| {
                    let primitive = &mut document["meshes"][0]["primitives"][0];
                    primitive["targets"] = copies(&serde_json::json!({ "POSITION": 0 }), 20);
                    document["nodes"] = copies(&document["nodes"][0], 20);
                }),
            ),
            (
                "lights.gltf",
                scene(&|document| {
                    let light = serde_json::json!({ "name": long, "type": "point" });
                    let lights = serde_json::json!({ "lights": [light] });
                    document["extensions"]["KHR_lights_punctual"] = lights;
                    let node = serde_json::json!({ "extensions": { "KHR_lights_punctual": { "light": 0 } } });
                    document["nodes"] = copies(&node, 4000);
                }),
            ),
        ];
        for (name, text) in files {
            let read = |power: u32| {
                let limits = Limits {
                    scene_bytes: 1 << power,
                    ..Limits::default()
                };
                let nothing = Vec::new();
                let (scene, peak) =
                    measured(|| import(name, text.as_bytes(), &Files(&nothing), &limits));
                let most = (2 << power) + text.len();
                assert!(peak <= most, "{name}: {peak} bytes, not {most}");
                scene.is_ok()
            };
            let least = (16..28).find(|&power| read(power));
            // Names alone would take hundreds of megabytes.
            assert!(least.is_some_and(|power| power <= 25), "{name}: {least:?}");
        }
    }
}
