//! Texture atlases: every triangle has texels of its own, whatever the scene.

use std::collections::HashMap;

use glam::{Mat4, Quat, Vec2, Vec3};
use gpugi_scene::atlas::{
    Atlas, AtlasError, AtlasOptions, InstanceUvs, NO_CHART, Seams, SecondSetFault, Side,
    TexelDensity, check_second_set,
};
use gpugi_scene::builtin::{builtin, shapes};
use gpugi_scene::{Material, Mesh, Scene};

const SIZE: u32 = 256;

fn small() -> AtlasOptions {
    AtlasOptions {
        size: SIZE,
        ..Default::default()
    }
}

fn triangles(uvs: &InstanceUvs) -> impl Iterator<Item = ([Vec2; 3], u32)> {
    let corners = uvs.corners.as_chunks::<3>().0.iter().copied();
    corners.zip(uvs.charts.iter().copied())
}

fn doubled_area([a, b, c]: [Vec2; 3]) -> f32 {
    (b - a).perp_dot(c - a)
}

/// The texels that a triangle touches, by separating axes.
fn touched([a, b, c]: [Vec2; 3], size: u32) -> Vec<(u32, u32)> {
    let [a, b, c] = [a, b, c].map(|uv| (uv * size as f32).as_dvec2());
    let (low, high) = (a.min(b).min(c).floor(), a.max(b).max(c).floor());
    let mut found = Vec::new();
    for y in low.y as u32..=(high.y as u32).min(size - 1) {
        for x in low.x as u32..=(high.x as u32).min(size - 1) {
            let middle = glam::DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5);
            let is_apart = [(a, b, c), (b, c, a), (c, a, b)].iter().any(|&(p, q, r)| {
                let normal = (q - p).perp();
                let inside = normal * normal.dot(r - p).signum();
                // The corner of the texel that reaches furthest inside.
                let reach = (inside.x.abs() + inside.y.abs()) / 2.0;
                inside.dot(middle - p) + reach <= 1e-6
            });
            if !is_apart {
                found.push((x, y));
            }
        }
    }
    found
}

/// Everything that an atlas promises.
fn assert_sound(name: &str, scene: &Scene, atlas: &Atlas, gutter: u32) {
    atlas
        .check(scene)
        .unwrap_or_else(|reason| panic!("{name}: {reason}"));
    let mut owners: HashMap<(u32, u32, u32), (usize, Side, u32)> = HashMap::new();
    // Samples inside triangles: a sample in two is an overlap within a chart.
    const FINER: u32 = 3;
    let mut samples: HashMap<(u32, u32, u32), u32> = HashMap::new();
    let (mut overlapped, mut sampled) = (0, 0);
    for (index, side, uvs) in atlas.sides() {
        for (corners, chart) in triangles(uvs) {
            if chart == NO_CHART {
                let extent = corners[1].distance(corners[0]) + corners[2].distance(corners[0]);
                assert!(extent * atlas.size as f32 <= 1e-2 || doubled_area(corners) == 0.0);
                continue;
            }
            assert!(doubled_area(corners) > 0.0, "{name}: mirrored");
            for (x, y) in touched(corners, atlas.size) {
                let own = (index, side, chart);
                let owner = *owners.entry((uvs.page, x, y)).or_insert(own);
                assert_eq!(owner, own, "{name}: two charts touch {x}, {y}");
            }
            let size = (atlas.size * FINER) as f32;
            let texels = corners.map(|uv| uv * size);
            let low = texels[0].min(texels[1]).min(texels[2]);
            let high = texels[0].max(texels[1]).max(texels[2]);
            for y in low.y as u32..=high.y as u32 {
                for x in low.x as u32..=high.x as u32 {
                    let p = Vec2::new(x as f32 + 0.4871, y as f32 + 0.5133);
                    let [a, b, c] = texels;
                    let inside = [[a, b, p], [b, c, p], [c, a, p]];
                    if inside.iter().all(|&edge| doubled_area(edge) > 1e-3) {
                        let count = samples.entry((uvs.page, x, y)).or_insert(0);
                        *count += 1;
                        sampled += 1;
                        overlapped += u32::from(*count > 1);
                    }
                }
            }
        }
    }
    assert!(sampled > 0, "{name}: empty");
    assert_eq!(overlapped, 0, "{name}: of {sampled} samples");
    let reach = gutter as i32;
    for (&(page, x, y), owner) in &owners {
        for (dx, dy) in [(reach, 0), (0, reach), (reach, reach), (reach, -reach)] {
            let at = (page, (x as i32 + dx) as u32, (y as i32 + dy) as u32);
            if let Some(other) = owners.get(&at) {
                assert_eq!(other, owner, "{name}: {x}, {y} and {at:?}");
            }
        }
    }
}

fn world_area(scene: &Scene, instance: usize) -> f64 {
    let placed = &scene.instances[instance];
    let mesh = &scene.meshes[placed.mesh];
    let triangles = mesh.indices.as_chunks::<3>().0.iter();
    triangles
        .map(|triangle| {
            let [a, b, c] = triangle.map(|index| {
                placed
                    .world_from_mesh
                    .transform_point3(mesh.positions[index as usize])
            });
            f64::from((b - a).cross(c - a).length()) / 2.0
        })
        .sum()
}

fn texel_area(uvs: &InstanceUvs, size: u32) -> f64 {
    let areas = triangles(uvs).map(|(corners, _)| f64::from(doubled_area(corners)) / 2.0);
    areas.sum::<f64>() * f64::from(size).powi(2)
}

#[test]
fn builtin_scenes_fit_a_page_without_overlap() {
    for name in ["cornell", "room", "teapot", "spheres", "shapes", "chamber"] {
        let scene = builtin(name, 1).unwrap();
        let size = if name == "chamber" { 448 } else { SIZE };
        let options = AtlasOptions {
            size,
            ..Default::default()
        };
        let atlas = Atlas::new(&scene, &options).unwrap();
        assert_eq!((atlas.size, atlas.pages), (size, 1), "{name}");
        assert!(atlas.instances.iter().all(Option::is_some), "{name}");
        assert_sound(name, &scene, &atlas, options.gutter);
        assert_eq!(atlas, Atlas::new(&scene, &options).unwrap(), "{name}");
    }
}

#[test]
fn backs_of_open_double_sided_meshes_have_texels_of_their_own() {
    let mut scene = Scene::new("sheets");
    let matt = Material::matt("grey", Vec3::splat(0.5));
    let single = scene.add_material(matt.clone());
    let double = scene.add_material(Material {
        double_sided: true,
        ..matt
    });
    let sheet = scene.add_mesh(shapes::quad(Vec3::ZERO, Vec3::X, Vec3::Y, 2));
    let closed = scene.add_mesh(shapes::cuboid(Vec3::ZERO, Vec3::ONE, 1));
    let smaller = Mat4::from_scale(Vec3::splat(0.75));
    for (mesh, material, matrix) in [
        (sheet, single, Mat4::IDENTITY),
        (sheet, double, Mat4::IDENTITY),
        (closed, double, Mat4::IDENTITY),
        (sheet, double, smaller),
    ] {
        scene.add_instance("", mesh, material, matrix);
    }
    let backs = AtlasOptions {
        backs: true,
        ..small()
    };
    let atlas = Atlas::new(&scene, &backs).unwrap();
    assert_sound("sheets", &scene, &atlas, backs.gutter);
    let with_back: Vec<bool> = atlas.backs.iter().map(Option::is_some).collect();
    assert_eq!(with_back, [false, true, false, true]);
    for index in [1, 3] {
        let sides = [&atlas.instances, &atlas.backs].map(|of| of[index].as_ref().unwrap());
        let [front, back] = sides.map(|uvs| texel_area(uvs, atlas.size));
        assert!((front / back - 1.0).abs() < 1e-3, "{front} {back}");
    }
    let fronts = Atlas::new(&scene, &small()).unwrap();
    assert_eq!(fronts.sides().count(), 4);
    let mut other = atlas.clone();
    other.backs[1].as_mut().unwrap().corners.pop();
    assert!(other.check(&scene).is_err());
}

#[test]
fn density_is_texels_per_metre_on_any_instance() {
    // Stretched, mirrored, turned and of very different sizes.
    let mut scene = Scene::new("boxes");
    let mesh = scene.add_mesh(shapes::cuboid(Vec3::splat(-0.5), Vec3::splat(0.5), 1));
    let material = scene.add_material(Material::matt("grey", Vec3::splat(0.5)));
    let turned = Quat::from_rotation_y(0.7);
    for (number, scale) in [
        Vec3::ONE,
        Vec3::ONE,
        Vec3::splat(-1.5),
        Vec3::new(4.0, 0.1, 0.3),
        Vec3::splat(0.05),
        Vec3::splat(4.0),
        Vec3::new(2.0, 2.0, 0.0),
    ]
    .into_iter()
    .enumerate()
    {
        let at = Vec3::X * number as f32;
        let matrix = Mat4::from_scale_rotation_translation(scale, turned, at);
        scene.add_instance("box", mesh, material, matrix);
    }
    scene.add_instance("nothing", mesh, material, Mat4::from_scale(Vec3::ZERO));
    let density = 20.0;
    let options = AtlasOptions {
        density: TexelDensity::PerMetre(density),
        ..small()
    };
    let atlas = Atlas::new(&scene, &options).unwrap();
    assert!(atlas.pages > 1);
    assert!(atlas.instances[7].is_none());
    assert_sound("boxes", &scene, &atlas, options.gutter);
    for (index, uvs) in atlas.instances.iter().enumerate().take(7) {
        let area = texel_area(uvs.as_ref().unwrap(), atlas.size);
        let wanted = world_area(&scene, index) * f64::from(density * density);
        assert!(
            (area / wanted - 1.0).abs() < 0.01,
            "{index}: {area} {wanted}"
        );
    }
    // The same shape, the same charts.
    let charts = |index: usize| &atlas.instances[index].as_ref().unwrap().charts;
    assert_eq!(charts(0), charts(1));
}

/// A square of two triangles, with a second set.
/// A ground of 100 km does not take the texels of the room that stands on it.
#[test]
fn a_large_ground_leaves_texels_to_what_stands_on_it() {
    let scene = builtin("cornell", 1).unwrap();
    let mut on_ground = scene.clone();
    let half = 5e4;
    let ground = shapes::quad(
        Vec3::new(-half, -1.0, half),
        Vec3::X * 2.0 * half,
        Vec3::NEG_Z * 2.0 * half,
        1,
    );
    let mesh = on_ground.add_mesh(ground);
    on_ground.add_instance("ground", mesh, 0, Mat4::IDENTITY);
    let texels = |scene: &Scene| -> f64 {
        let atlas = Atlas::new(scene, &small()).unwrap();
        let room = atlas.instances.iter().take(7).flatten();
        room.map(|uvs| texel_area(uvs, atlas.size)).sum()
    };
    let (alone, with_ground) = (texels(&scene), texels(&on_ground));
    println!("{alone} texels, with a ground {with_ground}");
    assert!(with_ground > 0.1 * alone, "{alone}, {with_ground}");
    // Where a density is asked for, everything has it.
    let mut dense = small();
    dense.density = TexelDensity::PerMetre(1e-3);
    let atlas = Atlas::new(&on_ground, &dense).unwrap();
    let ground = texel_area(
        atlas.instances.last().unwrap().as_ref().unwrap(),
        atlas.size,
    );
    assert!(
        (ground / 1e4 - 1.0).abs() < 0.01,
        "{ground} texels for 10^10 m^2"
    );
}

fn square(second: [Vec2; 4]) -> Mesh {
    let corners = [Vec2::ZERO, Vec2::X, Vec2::ONE, Vec2::Y];
    Mesh {
        positions: corners.map(|corner| corner.extend(0.0)).to_vec(),
        normals: vec![Vec3::Z; 4],
        uvs: [Vec::new(), second.to_vec()],
        indices: vec![0, 1, 2, 0, 2, 3],
        ..Default::default()
    }
}

#[test]
fn second_sets_are_told_from_others() {
    let whole = [Vec2::ZERO, Vec2::X, Vec2::ONE, Vec2::Y];
    assert_eq!(check_second_set(&square(whole)), Ok(()));
    assert_eq!(check_second_set(&square(whole.map(|uv| uv * 0.01))), Ok(()));
    let outside = check_second_set(&square(whole.map(|uv| uv * 1.5)));
    assert!(matches!(
        outside,
        Err(SecondSetFault::OutOfRange { vertex: 1, .. })
    ));
    let nan = check_second_set(&square([Vec2::NAN; 4]));
    assert!(matches!(nan, Err(SecondSetFault::OutOfRange { .. })));
    let folded = check_second_set(&square([Vec2::ZERO, Vec2::X, Vec2::ONE, Vec2::X]));
    assert_eq!(folded, Err(SecondSetFault::Overlap));
    let point = check_second_set(&square([Vec2::splat(0.5); 4]));
    assert_eq!(point, Err(SecondSetFault::Collapsed { share: 1.0 }));
    assert_eq!(
        check_second_set(&Mesh::default()),
        Err(SecondSetFault::None)
    );
}

#[test]
fn overlap_is_found_in_little_time_however_much_there_is() {
    let whole = [Vec2::ZERO, Vec2::X, Vec2::ONE, Vec2::Y];
    let mut mesh = square(whole);
    mesh.indices = mesh.indices.repeat(200_000);
    assert_eq!(check_second_set(&mesh), Err(SecondSetFault::Overlap));
}

#[test]
fn charts_of_a_valid_second_set_stay() {
    // Two squares with an edge in common, split for normals: two charts by itself, one in the set, where it is whole.
    let corners = [Vec2::ZERO, Vec2::X * 0.4, Vec2::splat(0.4), Vec2::Y * 0.4];
    let (mut mesh, other) = (square(corners), square(corners));
    mesh.positions
        .extend(other.positions.iter().map(|p| *p + Vec3::X));
    mesh.normals.extend(other.normals);
    mesh.uvs[1].extend(other.uvs[1].iter().map(|uv| *uv + Vec2::X * 0.4));
    mesh.indices.extend([4, 5, 6, 4, 6, 7]);
    let mut scene = Scene::new("squares");
    let mesh = scene.add_mesh(mesh);
    let material = scene.add_material(Material::matt("grey", Vec3::splat(0.5)));
    scene.add_instance("squares", mesh, material, Mat4::IDENTITY);
    let charts = |use_second_set| {
        let options = AtlasOptions {
            use_second_set,
            ..small()
        };
        let atlas = Atlas::new(&scene, &options).unwrap();
        assert_sound("squares", &scene, &atlas, options.gutter);
        atlas.instances[0].clone().unwrap().charts
    };
    assert_eq!(charts(true), [0, 0, 0, 0]);
    assert_eq!(charts(false), [0, 0, 1, 1]);
}

fn scene_of(mesh: Mesh) -> Scene {
    let mut scene = Scene::new("one");
    let mesh = scene.add_mesh(mesh);
    let material = scene.add_material(Material::matt("grey", Vec3::splat(0.5)));
    scene.add_instance("one", mesh, material, Mat4::IDENTITY);
    scene
}

fn soup(positions: Vec<Vec3>) -> Mesh {
    Mesh {
        normals: vec![Vec3::Y; positions.len()],
        indices: (0..positions.len() as u32).collect(),
        positions,
        ..Default::default()
    }
}

#[test]
fn hostile_meshes_get_an_atlas_or_an_error() {
    // What has no area is left out.
    for mesh in [
        Mesh::default(),
        soup(vec![Vec3::ONE; 30]),
        soup(vec![Vec3::ZERO, Vec3::X, Vec3::X * 2.0]),
        soup(vec![Vec3::ZERO, Vec3::X * 1e-30, Vec3::Y * 1e-30]),
    ] {
        let atlas = Atlas::new(&scene_of(mesh), &small()).unwrap();
        assert_eq!(atlas.instances, [None]);
    }
    // Triangles without area between others, and the same triangle often, both ways round.
    let (a, b, c) = (Vec3::ZERO, Vec3::X, Vec3::Y);
    let mut corners = vec![a, a, b, a, b, c];
    for _ in 0..20 {
        corners.extend([a, b, c, a, c, b]);
    }
    let scene = scene_of(soup(corners));
    let atlas = Atlas::new(&scene, &small()).unwrap();
    assert_sound("twins", &scene, &atlas, 2);
    assert_eq!(atlas.instances[0].as_ref().unwrap().charts[0], NO_CHART);
    assert_eq!(atlas.slivers(&scene), 1);
    // Slivers, and a triangle that is a million times as large as the others.
    let mut corners = vec![a, b * 1e3, c * 1e3];
    for step in 0..50 {
        let at = Vec3::Z * step as f32;
        corners.extend([at, at + Vec3::X, at + Vec3::X + Vec3::Y * 0.003]);
    }
    let scene = scene_of(soup(corners));
    let atlas = Atlas::new(&scene, &small()).unwrap();
    assert_sound("slivers", &scene, &atlas, 2);
    // No numbers.
    for bad in [f32::NAN, f32::INFINITY] {
        let scene = scene_of(soup(vec![a, b, Vec3::new(0.0, bad, 0.0)]));
        let refused = Atlas::new(&scene, &small());
        assert!(matches!(refused, Err(AtlasError::Mesh { mesh: 0, .. })));
        let mut scene = scene_of(soup(vec![a, b, c]));
        scene.instances[0].world_from_mesh = Mat4::from_scale(Vec3::new(1.0, bad, 1.0));
        let refused = Atlas::new(&scene, &small());
        assert!(matches!(
            refused,
            Err(AtlasError::Instance { instance: 0, .. })
        ));
    }
    let mut scene = scene_of(soup(vec![a, b, c]));
    scene.instances[0].world_from_mesh = Mat4::from_scale(Vec3::splat(1e30));
    assert!(Atlas::new(&scene, &small()).is_err());
    let mut mesh = soup(vec![a, b, c]);
    mesh.indices[1] = 7;
    assert!(matches!(
        Atlas::new(&scene_of(mesh), &small()),
        Err(AtlasError::Mesh { .. })
    ));
    assert_eq!(Atlas::new(&Scene::new("empty"), &small()).unwrap().pages, 0);
}

#[test]
fn sizes_are_refused_with_their_numbers() {
    let scene = builtin("cornell", 1).unwrap();
    let refused = |options: AtlasOptions| Atlas::new(&scene, &options).unwrap_err();
    let dense = |density, most_pages| AtlasOptions {
        density: TexelDensity::PerMetre(density),
        most_pages,
        ..small()
    };
    // Refused before any work.
    let error = refused(dense(1e5, 64));
    assert!(
        matches!(error, AtlasError::TooManyPages { limit: 64, .. }),
        "{error}"
    );
    assert!(
        error
            .to_string()
            .contains("pages of 256 texels a side, 64 are allowed")
    );
    // A wall alone is larger than a page.
    let error = refused(dense(300.0, 1000));
    assert!(
        matches!(error, AtlasError::PageTooSmall { size: 256, .. }),
        "{error}"
    );
    // Fits by area alone.
    let error = refused(dense(80.0, 1));
    assert!(
        matches!(error, AtlasError::TooManyPages { limit: 1, .. }),
        "{error}"
    );
    for (size, gutter, density) in [
        (0, 2, 1.0),
        (u32::MAX, 2, 1.0),
        (256, u32::MAX, 1.0),
        (256, 2, f32::NAN),
        (256, 2, -1.0),
        (256, 2, f32::INFINITY),
    ] {
        let error = refused(AtlasOptions {
            size,
            gutter,
            density: TexelDensity::PerMetre(density),
            ..Default::default()
        });
        assert!(matches!(error, AtlasError::Option { .. }), "{error}");
    }
    let cancelled = Atlas::with_progress(&scene, &small(), |_| false);
    assert_eq!(cancelled, Err(AtlasError::Cancelled));
}

#[test]
fn atlases_of_other_scenes_are_told() {
    let scene = builtin("cornell", 1).unwrap();
    let atlas = Atlas::new(&scene, &small()).unwrap();
    assert!(atlas.check(&builtin("room", 1).unwrap()).is_err());
    let spoil = |change: fn(&mut InstanceUvs)| {
        let mut other = atlas.clone();
        change(other.instances[0].as_mut().unwrap());
        other.check(&scene).unwrap_err()
    };
    assert!(spoil(|uvs| uvs.page = 1).contains("page 1 of 1"));
    assert!(spoil(|uvs| uvs.corners[2].x = f32::NAN).contains("corner 2"));
    assert!(spoil(|uvs| uvs.corners[2].y = 1.01).contains("corner 2"));
    assert!(spoil(|uvs| uvs.charts.clear()).contains("charts"));
}

#[test]
fn seams_of_smooth_surfaces_close_and_hard_edges_stay() {
    let scene = scene_of(shapes::sphere(1.0, 16));
    let atlas = Atlas::new(&scene, &small()).unwrap();
    let seams = Seams::new(&scene, &atlas);
    assert!(!seams.is_empty());
    // What lies far apart in the page differs, so that charts do not fit at their borders.
    let at = |index: usize| Vec2::new((index as u32 % SIZE) as f32, (index as u32 / SIZE) as f32);
    let color = |index| Vec3::new(1.0 + at(index).x / 256.0, 2.0 - at(index).y / 256.0, 1.0);
    let before: Vec<Vec3> = (0..(SIZE * SIZE) as usize).map(color).collect();
    let mut after = before.clone();
    seams.smooth(&mut after);
    let [was, is] = [&before, &after].map(|image| seams.difference(image));
    assert!(is < 0.1 * was, "{was} to {is}");
    let changed = before.iter().zip(&after).filter(|(a, b)| a != b).count();
    assert!(
        changed > 100 && changed < before.len() / 3,
        "{changed} texels"
    );
    // No more than it takes, and nothing where nothing differs.
    let worst = before.iter().zip(&after).map(|(a, b)| a.distance(*b));
    assert!(worst.fold(0.0, f32::max) < 1.5);
    assert!(after.iter().all(|texel| (texel.z - 1.0).abs() < 1e-5));

    let scene = scene_of(shapes::cuboid(Vec3::ZERO, Vec3::ONE, 2));
    let atlas = Atlas::new(&scene, &small()).unwrap();
    assert!(Seams::new(&scene, &atlas).is_empty());
    let mut dark = vec![Vec3::NAN; (SIZE * SIZE) as usize];
    Seams::new(&scene, &atlas).smooth(&mut dark);
}
