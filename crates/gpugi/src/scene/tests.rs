//! Rust structs and WGSL structs are the same: sizes, names and offsets by reflection, table rows word by word.

use super::Claims;
use super::gpu::{Instance, Material, SceneHeader, TextureReference, Vertex, octahedral};
use crate::capture::atlas::PieceUniform;
use crate::capture::atlas::blocks::AtlasTriangle;
use crate::capture::atlas::dilate::LevelsUniform;
use crate::capture::atlas::gather::OwnUniform;
use crate::capture::atlas::leaks::LeakSettings;
use crate::capture::atlas::seams::{BesideRow, SampleRow, TermRow};
use crate::capture::depth::DepthViewUniform;
use crate::capture::depth::compute::{self, ParallelView};
use crate::capture::{SURFACE_POINT_BYTES, ViewUniform};
use crate::gpu::Shader;
use crate::impostor::gpu::Impostor;
use crate::lights::gpu::LightSample;
use crate::ray_bench;
use crate::shader;
use crate::techniques::caustics::gpu::{CausticMap, LIT_TEXEL_BYTES, LitCube, PHOTON_BYTES};
use crate::techniques::environment_map::gpu::{Lobe, LookupSettings};
use crate::techniques::image_based_lighting::gpu as domains;
use crate::techniques::obscurances::gpu as obscurances;
use crate::techniques::radiosity::gpu::{CHILDREN, Chosen, Level, MOST_CHOSEN, TEXEL_BYTES, Work};
use crate::techniques::shadow_map::gpu::GatherSettings;
use crate::testing::{constant, run_kernel, test_gpu};

/// Size and members (name, offset) of the struct whose linked name ends in `name`; structs inside it are taken apart.
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

#[test]
fn uniforms_and_storage_structs_have_one_layout() {
    let gather = shader!("techniques.shadow_map.gather");
    let header = layout!(SceneHeader: instance_row material_row texture_row instance_count environment_rotation
        environment_intensity diagonal bvh_start padding_0 padding_1);
    assert_eq!(reflected(&shader!("scene.bindings"), "SceneHeader"), header);
    let view = layout!(ViewUniform: origin width origin_dx height origin_dy sample_index direction seed direction_dx
        faces direction_dy first_row);
    for shader in [
        shader!("capture.resolve"),
        shader!("capture.emission"),
        gather,
    ] {
        assert_eq!(reflected(&shader, "View"), view, "{}", shader.name);
    }
    let depth_view = layout!(DepthViewUniform: clip_from_world tile texel near range atlas_texel);
    for shader in [
        shader!("capture.depth"),
        shader!("capture.depth_alpha"),
        gather,
    ] {
        assert_eq!(
            reflected(&shader, "DepthView"),
            depth_view,
            "{}",
            shader.name
        );
    }
    let parallel = layout!(ParallelView: x y depth corner width height padding);
    let drawn = layout!(compute::Range: first_view view_count first_triangle end_triangle first_row side padding_0 padding_1);
    for shader in [
        shader!("capture.depth.small"),
        shader!("capture.depth.large"),
    ] {
        assert_eq!(reflected(&shader, "ParallelView"), parallel);
        assert_eq!(reflected(&shader, "Range"), drawn);
    }
    assert_eq!(reflected(&shader!("capture.depth.resolve"), "Range"), drawn);
    let sample = layout!(LightSample: position kind direction first_view intensity view_count tangent radius
        cone_scale cone_offset inverse_range_squared area);
    assert_eq!(reflected(&gather, "LightSample"), sample);
    let piece =
        layout!(PieceUniform: size first_row end_row phase block_count lobes area_unit padding);
    let triangle = layout!(AtlasTriangle: instance primitive a b c);
    for shader in [
        shader!("capture.atlas.cover"),
        shader!("capture.atlas.resolve"),
    ] {
        assert_eq!(reflected(&shader, "Piece"), piece);
        assert_eq!(reflected(&shader, "AtlasTriangle"), triangle);
    }
    let leaks = layout!(LeakSettings: share reach offset first end);
    assert_eq!(
        reflected(&shader!("capture.atlas.leaks"), "Settings"),
        leaks
    );
    let levels = layout!(LevelsUniform: fine coarse fine_size coarse_size padding);
    assert_eq!(
        reflected(&shader!("capture.atlas.dilate"), "Levels"),
        levels
    );
    let seams = shader!("capture.atlas.seams");
    assert_eq!(
        reflected(&seams, "Sample"),
        layout!(SampleRow: texels weights)
    );
    let beside = layout!(BesideRow: texel first end weight);
    assert_eq!(reflected(&seams, "Beside"), beside);
    assert_eq!(reflected(&seams, "Term"), layout!(TermRow: index weight));
    let bench = layout!(ray_bench::Settings: eye width direction height direction_dx offset direction_dy seed light padding);
    assert_eq!(reflected(&shader!("ray_bench.rays"), "Settings"), bench);
    let settings = layout!(GatherSettings: kind radius taps normal_offset cascade_blend second_depth area_taps padding
        first_light end_light first_point end_point);
    assert_eq!(reflected(&gather, "GatherSettings"), settings);
    let reduce = shader!("techniques.image_based_lighting.reduce");
    let grid = layout!(domains::Grid: width height stride padding);
    assert_eq!(reflected(&reduce, "Grid"), grid);
    let decompose = shader!("techniques.image_based_lighting.domains");
    let settings =
        layout!(domains::Settings: width height stride side count squared warm tolerance);
    assert_eq!(reflected(&decompose, "Settings"), settings);
    let state = layout!(domains::State: most share moving movement);
    assert_eq!(reflected(&decompose, "State"), state);
    let domain = layout!(domains::Domain: direction solid_angle flux_density lit_solid_angle);
    assert_eq!(reflected(&decompose, "Domain"), domain);
    let gather = shader!("techniques.image_based_lighting.gather");
    let direction = layout!(domains::Direction: toward solid_angle flux_density texel);
    assert_eq!(reflected(&gather, "Direction"), direction);
    let map = layout!(domains::DirectionMap: u v depth);
    assert_eq!(reflected(&gather, "DirectionMap"), map);
    let range = layout!(domains::Range: first end radius normal_offset);
    assert_eq!(reflected(&gather, "Range"), range);
    let sums = layout!(domains::LobeSums: lit_diffuse all_glossy_r all_diffuse all_glossy_g lit_glossy all_glossy_b);
    let prefiltered = shader!("techniques.image_based_lighting.prefiltered");
    assert_eq!(reflected(&prefiltered, "LobeSums"), sums);
    let lobe = layout!(Lobe: kind width samples padding);
    let prefilter = shader!("techniques.environment_map.prefilter");
    assert_eq!(reflected(&prefilter, "Lobe"), lobe);
    let lookup = layout!(LookupSettings: irradiance phong_cosine last_level approximate_metals);
    let gather = shader!("techniques.environment_map.gather");
    assert_eq!(reflected(&gather, "LookupSettings"), lookup);
    let impostor = layout!(Impostor: reference instance center search iterations bounces is_refracting is_classical
        world_from_shape);
    let gather = shader!("techniques.distance_impostor.gather");
    assert_eq!(reflected(&gather, "Impostor"), impostor);
    let (size, own) = layout!(CausticMap: reference cube_side side first end is_perspective pixel_area unit counts seed lanes);
    let (_, light) = sample;
    let map = (size, [light, own].concat());
    for shader in [
        shader!("techniques.caustics.trace"),
        shader!("techniques.caustics.splat"),
    ] {
        assert_eq!(reflected(&shader, "CausticMap"), map, "{}", shader.name);
    }
    let photon = reflected(&shader!("techniques.caustics.splat"), "Photon");
    assert_eq!(u64::from(photon.0), PHOTON_BYTES);
    let gather = shader!("techniques.caustics.gather");
    let cube = layout!(LitCube: reference side instance);
    assert_eq!(reflected(&gather, "LitCube"), cube);
    let texel = reflected(&gather, "LitTexel");
    assert_eq!(u64::from(texel.0), LIT_TEXEL_BYTES);
    let work =
        layout!(Work: first_texel count rays burn_in seed with_environment texels chosen aimed);
    for shader in [
        shader!("techniques.radiosity.rays"),
        shader!("techniques.radiosity.choose"),
        shader!("techniques.radiosity.receive"),
    ] {
        assert_eq!(reflected(&shader, "Work"), work, "{}", shader.name);
        let texel = reflected(&shader, "Texel");
        assert_eq!(u64::from(texel.0), TEXEL_BYTES);
    }
    let sum = shader!("techniques.radiosity.sum");
    let level = layout!(Level: fine fine_count coarse padding);
    assert_eq!(reflected(&sum, "Level"), level);
    let children = constant(&sum, "radiosity_pyramid", "CHILDREN");
    assert_eq!(children, CHILDREN);
    let chosen = layout!(Chosen: position area normal turn outgoing power);
    for shader in [
        shader!("techniques.radiosity.rays"),
        shader!("techniques.radiosity.choose"),
        shader!("techniques.radiosity.hemicubes"),
    ] {
        assert_eq!(reflected(&shader, "Chosen"), chosen, "{}", shader.name);
    }
    let most = constant(
        &shader!("techniques.radiosity.rays"),
        "radiosity_chosen",
        "MOST_CHOSEN",
    );
    assert_eq!(most, MOST_CHOSEN);
}

#[test]
fn structs_of_obscurances_have_one_layout() {
    let prepare = shader!("techniques.obscurances.prepare");
    let rays = shader!("techniques.obscurances.rays");
    let transfer = shader!("techniques.obscurances.transfer");
    let settings = layout!(obscurances::SettingsUniform: distance falloff seed first_texel first_point end_point
        first_sample end_sample);
    let texel = reflected(&prepare, "Texel");
    assert_eq!(u64::from(texel.0), obscurances::TEXEL_BYTES);
    assert_eq!(reflected(&transfer, "AtomicTexel"), texel);
    for shader in [prepare, rays, transfer] {
        assert_eq!(reflected(&shader, "Settings"), settings, "{}", shader.name);
    }
    let row = layout!(obscurances::BoxRow: low padding_0 high padding_1);
    assert_eq!(reflected(&prepare, "Box"), row);
    let renewal = layout!(obscurances::Renewal: all box_count finished padding);
    assert_eq!(reflected(&prepare, "Renewal"), renewal);
    let page = layout!(obscurances::PageUniform: first count side padding);
    assert_eq!(
        reflected(&shader!("techniques.obscurances.resolve"), "Page"),
        page
    );
    let own = layout!(OwnUniform: first_texel is_own padding);
    for shader in [
        shader!("techniques.obscurances.gather"),
        shader!("techniques.radiosity.gather"),
    ] {
        assert_eq!(reflected(&shader, "Own"), own, "{}", shader.name);
    }
    let view = layout!(obscurances::PeelView: clip_from_world seed);
    assert_eq!(
        reflected(&shader!("techniques.obscurances.peel"), "AlphaView"),
        view
    );
    let bundle = layout!(obscurances::Bundle: origin range origin_dx first_column origin_dy first_row direction end_column
        end_row side layers padding);
    assert_eq!(reflected(&transfer, "Bundle"), bundle);
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
    let depth = shader!("capture.depth_alpha");
    let shadow = constant(&depth, "scene_tables", "CLAIM_SHADOW");
    assert_eq!(shadow, Claims::SHADOW.0);
}

#[test]
fn depth_passes_and_buffers_agree_on_strides() {
    // An array of structs with fewer members than the host writes would find each but the first in the wrong place.
    let stride = std::mem::size_of::<DepthViewUniform>() as u32;
    for shader in [shader!("capture.depth"), shader!("capture.depth_alpha")] {
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
        first_index_word first_merged_vertex material vertex_count mirrored closed claims);
    assert_eq!(names(reflected(&shader, "Instance")), names(instance));
    let material = layout!(Material: base_color emissive alpha_cutoff metallic roughness dielectric_f0 specular
        specular_color transmission model_a shininess model_b normal_scale model alpha_mode double_sided
        base_color_texture metallic_roughness_texture normal_texture emissive_texture specular_texture
        specular_color_texture transmission_texture solid padding absorption ior);
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

/// A row whose words are all different, and different from those of rows with another `first`: small normal floats.
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
