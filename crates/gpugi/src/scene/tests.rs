//! Strides, constants and table rows that host and shaders share; testing/layouts.rs compares whole structs.

use super::Claims;
use super::gpu::{Instance, Material, SceneHeader, TextureReference, Vertex, octahedral};
use crate::capture::SURFACE_POINT_BYTES;
use crate::capture::depth::DepthViewUniform;
use crate::gpu::Shader;
use crate::shader;
use crate::techniques::caustics::gpu::{LIT_TEXEL_BYTES, PHOTON_BYTES};
use crate::techniques::obscurances::gpu as obscurances;
use crate::techniques::radiosity::gpu::{CHILDREN, MOST_CHOSEN, TEXEL_BYTES};
use crate::testing::{constant, run_kernel, test_gpu};

/// Size and members (name, offset) of the struct whose linked name ends in `name`; nested structs are flattened.
fn reflected(shader: &Shader, name: &str) -> (u32, Vec<(String, u32)>) {
    let module = shader.parse().unwrap();
    let (_, ty) = module
        .types
        .iter()
        .find(|(_, ty)| {
            let linked = ty.name.as_deref().unwrap_or_default();
            linked == name || linked.ends_with(&format!("_{name}"))
        })
        .unwrap_or_else(|| panic!("{} has no struct {name}", shader.name));
    let naga::TypeInner::Struct { span, .. } = ty.inner else {
        panic!("{name} is no struct");
    };
    let mut members = Vec::new();
    flatten(&module, ty, 0, &mut members);
    (span, members)
}

fn flatten(module: &naga::Module, ty: &naga::Type, base: u32, members: &mut Vec<(String, u32)>) {
    let naga::TypeInner::Struct { members: own, .. } = &ty.inner else {
        return;
    };
    for member in own {
        let inner = &module.types[member.ty];
        if matches!(inner.inner, naga::TypeInner::Struct { .. }) {
            flatten(module, inner, base + member.offset, members);
        } else {
            members.push((
                member.name.clone().unwrap_or_default(),
                base + member.offset,
            ));
        }
    }
}

/// Size and members (name, offset) of a Rust struct.
macro_rules! layout {
    ($ty:ty: $($field:ident)+) => {
        (
            std::mem::size_of::<$ty>() as u32,
            vec![$((stringify!($field).to_owned(), std::mem::offset_of!($ty, $field) as u32)),+],
        )
    };
}

/// Buffers whose elements only shaders write have as many bytes per element as the host allocates.
#[test]
fn strides_of_buffers_are_those_of_their_structs() {
    for (shader, name, bytes) in [
        (
            shader!("capture.resolve"),
            "PackedSurfacePoint",
            SURFACE_POINT_BYTES,
        ),
        (shader!("techniques.caustics.splat"), "Photon", PHOTON_BYTES),
        (
            shader!("techniques.caustics.gather"),
            "LitTexel",
            LIT_TEXEL_BYTES,
        ),
        (shader!("techniques.radiosity.rays"), "Texel", TEXEL_BYTES),
        (
            shader!("techniques.obscurances.prepare"),
            "Texel",
            obscurances::TEXEL_BYTES,
        ),
        (
            shader!("techniques.obscurances.transfer"),
            "AtomicTexel",
            obscurances::TEXEL_BYTES,
        ),
    ] {
        assert_eq!(
            u64::from(reflected(&shader, name).0),
            bytes,
            "{name} of {}",
            shader.name
        );
    }
    let sum = shader!("techniques.radiosity.sum");
    assert_eq!(constant(&sum, "radiosity_pyramid", "CHILDREN"), CHILDREN);
    let most = constant(
        &shader!("techniques.radiosity.rays"),
        "radiosity_chosen",
        "MOST_CHOSEN",
    );
    assert_eq!(most, MOST_CHOSEN);
}

#[test]
fn claims_are_the_same_bits() {
    let gather = shader!("techniques.environment_map.gather");
    for (name, claims) in [
        ("CLAIM_ENVIRONMENT", Claims::ENVIRONMENT),
        ("CLAIM_TRANSMISSION", Claims::TRANSMISSION),
        ("CLAIM_SPECULAR", Claims::SPECULAR),
        ("CLAIM_REFRACTION", Claims::REFRACTION),
    ] {
        assert_eq!(constant(&gather, "scene_tables", name), claims.0, "{name}");
    }
    let rays = constant(
        &shader!("techniques.ray_tracing.begin"),
        "scene_tables",
        "CLAIM_RAYS",
    );
    assert_eq!(rays, Claims::RAYS.0);
    let depth = shader!("capture.depth_alpha");
    let shadow = constant(&depth, "scene_tables", "CLAIM_SHADOW");
    assert_eq!(shadow, Claims::SHADOW.0);
    let final_gather = shader!("techniques.final_gather.gather");
    let glossy = constant(&final_gather, "scene_tables", "CLAIM_GLOSSY");
    assert_eq!(glossy, Claims::GLOSSY.0);
    let impostor = shader!("techniques.distance_impostor.gather");
    let shift = constant(&impostor, "scene_tables", "IMPOSTOR_SHIFT");
    assert_eq!(Claims::NONE.with_impostor(1).0, 1 << shift);
}

#[test]
fn depth_passes_and_buffers_agree_on_strides() {
    // If an array's struct had fewer members than the host writes, every element but the first would be read from the
    // wrong place.
    let stride = std::mem::size_of::<DepthViewUniform>() as u32;
    for shader in [
        shader!("capture.depth"),
        shader!("capture.depth_alpha"),
        shader!("capture.depth.transmittance"),
    ] {
        let module = shader.parse().unwrap();
        let views = module
            .global_variables
            .iter()
            .find(|(_, variable)| variable.name.as_deref() == Some("views"));
        let (_, views) = views.expect("views");
        match module.types[views.ty].inner {
            naga::TypeInner::Array { stride: found, .. } => {
                assert_eq!(found, stride, "{}", shader.name)
            }
            ref other => panic!("{other:?}"),
        }
    }
    let (bytes, _) = reflected(&shader!("capture.resolve"), "PackedSurfacePoint");
    assert_eq!(u64::from(bytes), SURFACE_POINT_BYTES);
    let (bytes, _) = reflected(&shader!("capture.merge"), "MergedVertex");
    assert_eq!(u64::from(bytes), crate::gpu::RasterKernel::VERTEX_STRIDE);
}

#[test]
fn table_structs_have_the_same_members_in_the_same_order() {
    let names = |(_, members): (u32, Vec<(String, u32)>)| -> Vec<String> {
        members.into_iter().map(|(name, _)| name).collect()
    };
    let shader = shader!("testing.tables");
    let instance = layout!(Instance: world_from_mesh_0 world_from_mesh_1 world_from_mesh_2 first_vertex_word
        first_index_word first_merged_vertex material vertex_count mirrored closed claims sphere);
    assert_eq!(names(reflected(&shader, "Instance")), names(instance));
    let material = layout!(Material: base_color emissive alpha_cutoff metallic roughness dielectric_f0 specular
        specular_color transmission model_a shininess model_b normal_scale model alpha_mode double_sided
        base_color_texture metallic_roughness_texture normal_texture emissive_texture specular_texture
        specular_color_texture transmission_texture solid diffuse_transmission_texture absorption ior diffuse_transmission_color
        diffuse_transmission diffuse_transmission_color_texture padding_0 padding_1 padding_2);
    assert_eq!(names(reflected(&shader, "Material")), names(material));
    let texture = layout!(TextureReference: uv_from_mesh translation mode layer width height padding_0 padding_1);
    assert_eq!(
        names(reflected(&shader, "TextureReference")),
        names(texture)
    );
    let vertex = layout!(Vertex: position normal tangent uv_0 uv_1 color);
    assert_eq!(names(reflected(&shader, "Vertex")), names(vertex));
    assert_eq!(std::mem::size_of::<Vertex>(), 12 * 4);
}

/// A row whose words all differ from each other and from those of rows with another `first`: small normal floats.
fn distinct<T: bytemuck::Pod>(first: u32) -> T {
    let words: Vec<u32> = (0..std::mem::size_of::<T>() as u32 / 4)
        .map(|word| 0x3f80_0000 + first + word)
        .collect();
    bytemuck::pod_read_unaligned(bytemuck::cast_slice(&words))
}

#[test]
fn tables_are_read_as_they_are_written() {
    let Some(gpu) = test_gpu() else { return };
    let instances: [Instance; 2] = [distinct(0), distinct(100)];
    let materials: [Material; 2] = [distinct(200), distinct(300)];
    let textures: [TextureReference; 2] = [distinct(400), distinct(500)];
    let vertices: [Vertex; 2] = [distinct(600), distinct(700)];
    let mut tables: Vec<u8> = Vec::new();
    tables.extend(bytemuck::cast_slice::<_, u8>(&instances));
    let material_row = tables.len() as u32 / 16;
    tables.extend(bytemuck::cast_slice::<_, u8>(&materials));
    let texture_row = tables.len() as u32 / 16;
    tables.extend(bytemuck::cast_slice::<_, u8>(&textures));
    let header = SceneHeader {
        instance_row: 0,
        material_row,
        texture_row,
        ..bytemuck::Zeroable::zeroed()
    };
    let header = gpu.uniform("header", &header).unwrap();
    let tables = gpu.storage("tables", &tables).unwrap();
    let geometry = gpu.storage("geometry", &vertices).unwrap();
    let mut expected: Vec<u32> = Vec::new();
    expected.extend(bytemuck::cast_slice::<_, u32>(&instances[1..]));
    expected.extend(bytemuck::cast_slice::<_, u32>(&materials[1..]));
    expected.extend(bytemuck::cast_slice::<_, u32>(&textures[1..]));
    // Its last word is padding.
    let vertex: &[u32] = bytemuck::cast_slice(&vertices[1..]);
    expected.extend(&vertex[..vertex.len() - 1]);
    let inputs = [
        ("package_scene_bindings_header", &header),
        ("package_scene_bindings_tables", &tables),
        ("package_scene_bindings_geometry", &geometry),
    ];
    let found: Vec<u32> = run_kernel(
        &gpu,
        &shader!("testing.tables"),
        "main",
        &inputs,
        expected.len(),
        1,
    )
    .unwrap();
    assert_eq!(found, expected);
}

#[test]
fn octahedral_codes_of_axes_are_exact() {
    assert_eq!(octahedral(glam::Vec3::Z), 0);
    assert_eq!(octahedral(glam::Vec3::X), 32767);
    assert_eq!(octahedral(glam::Vec3::Y), 32767 << 16);
    assert_eq!(octahedral(glam::Vec3::NEG_X), 0x8001);
}
