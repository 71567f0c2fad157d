//! Changes of a scene that must not change its picture.

use std::collections::BTreeMap;
use std::f32::consts::FRAC_PI_2;
use std::sync::Arc;

use glam::{Mat3, Mat4, Vec3, Vec4, vec3};
use gpugi_scene::builtin::shapes::{cuboid, join, quad};
use gpugi_scene::{
    Environment, Image, Instance, Light, LightKind, Material, Mesh, Pixels, Projection, Scene,
};

use super::scenes::OUTSIDE;
use crate::common::{inside_out, place};

/// A changed scene, and how its light compares with that of the scene before.
pub struct Changed {
    pub scene: Scene,
    /// The picture is mirrored left to right.
    pub is_mirrored: bool,
    /// A position in the scene before from one in this scene.
    pub before_from_world: Mat4,
    /// Instances from this index on were not in the scene before.
    pub first_added: usize,
}

impl Changed {
    /// The scene itself.
    pub fn of(scene: &Scene) -> Self {
        Self::in_place(scene.clone())
    }

    /// Everything stays where it was, and nothing is added.
    fn in_place(scene: Scene) -> Self {
        let first_added = scene.instances.len();
        Self {
            scene,
            is_mirrored: false,
            before_from_world: Mat4::IDENTITY,
            first_added,
        }
    }

    /// With instances added to those of `before`.
    fn with_more(scene: Scene, before: &Scene) -> Self {
        Self {
            first_added: before.instances.len(),
            ..Self::in_place(scene)
        }
    }
}

/// Makes the changed scene; `None` if the change makes no sense there.
pub type Relation = fn(&Scene) -> Option<Changed>;

pub const RELATIONS: [(&str, Relation); 25] = [
    ("itself", |scene| Some(Changed::of(scene))),
    ("1000 times smaller", |scene| scaled(scene, 1e-3)),
    ("1000 times larger", |scene| scaled(scene, 1e3)),
    ("10000 times smaller", |scene| scaled(scene, 1e-4)),
    ("10000 times larger", |scene| scaled(scene, 1e4)),
    ("moved", |scene| {
        let matrix = Mat4::from_translation(vec3(37.0, -12.0, 81.0));
        Some(carried(scene, matrix, Mat4::IDENTITY))
    }),
    ("turned by 90 degrees", |scene| turned(scene, FRAC_PI_2)),
    ("turned by 37 degrees", |scene| {
        turned(scene, 37.0_f32.to_radians())
    }),
    ("mirrored", mirrored),
    ("transforms in vertices", |scene| {
        let all = scene.instances.iter();
        let is_trivial = all
            .clone()
            .all(|instance| instance.world_from_mesh == Mat4::IDENTITY);
        (!is_trivial).then(|| remade(scene, |instance| instance.world_from_mesh))
    }),
    ("meshes in centimetres", |scene| {
        Some(remade(scene, |_| Mat4::from_scale(Vec3::splat(100.0))))
    }),
    ("tilted meshes", |scene| {
        let tilt = Mat4::from_rotation_x(0.3) * Mat4::from_rotation_z(0.2);
        Some(remade(scene, |_| tilt))
    }),
    ("sheared meshes", |scene| {
        let mut shear = Mat4::from_scale(vec3(2.0, 0.5, 1.0));
        (shear.y_axis.x, shear.z_axis.y) = (0.6, -0.3);
        Some(remade(scene, |_| shear))
    }),
    ("merged", merged),
    ("split", split),
    ("doubled", doubled),
    ("backed", backed),
    ("subdivided", |scene| Some(reshaped(scene, subdivided))),
    ("reversed", reversed),
    ("own vertices", |scene| {
        Some(reshaped(scene, |mesh| {
            let count = mesh.indices.len() as u32;
            mesh.with_vertices(&mesh.indices, (0..count).collect())
        }))
    }),
    ("something far away", far_away),
    ("on black ground", on_ground),
    ("two lights for one", two_lights),
    ("no light outside", |scene| {
        let is_outside = |light: &Light| light.name.as_str() == OUTSIDE;
        if !scene.lights.iter().any(is_outside) {
            return None;
        }
        let mut changed = Changed::of(scene);
        changed.scene.lights.retain(|light| !is_outside(light));
        Some(changed)
    }),
    ("colours in vertices", |scene| Some(colored(scene))),
];

/// The scene after `world_from_before`. `local` undoes its scale or reflection in the spaces of cameras and lights, whose
/// transforms stay rigid.
fn carried(scene: &Scene, world_from_before: Mat4, local: Mat4) -> Changed {
    let mut scene = scene.clone();
    let frames = (scene
        .cameras
        .iter_mut()
        .map(|camera| &mut camera.world_from_view))
    .chain(
        scene
            .lights
            .iter_mut()
            .map(|light| &mut light.world_from_light),
    );
    for frame in frames {
        *frame = world_from_before * *frame * local;
    }
    for instance in &mut scene.instances {
        instance.world_from_mesh = world_from_before * instance.world_from_mesh;
    }
    Changed {
        before_from_world: world_from_before.inverse(),
        ..Changed::in_place(scene)
    }
}

/// Radiance stays if the power of lights grows with areas.
fn scaled(scene: &Scene, scale: f32) -> Option<Changed> {
    let [matrix, local] = [scale, 1.0 / scale].map(|factor| Mat4::from_scale(Vec3::splat(factor)));
    let mut changed = carried(scene, matrix, local);
    for camera in &mut changed.scene.cameras {
        if let Projection::Orthographic { height } = &mut camera.projection {
            *height *= scale;
        }
    }
    for light in &mut changed.scene.lights {
        if light.kind != LightKind::Directional {
            light.intensity *= scale * scale;
            light.radius *= scale;
            light.range = light.range.map(|range| range * scale);
        }
    }
    Some(changed)
}

fn turned(scene: &Scene, angle: f32) -> Option<Changed> {
    let mut changed = carried(scene, Mat4::from_rotation_y(angle), Mat4::IDENTITY);
    if let Some(environment) = &mut changed.scene.environment {
        environment.rotation = glam::Quat::from_rotation_y(angle) * environment.rotation;
    }
    Some(changed)
}

fn mirrored(scene: &Scene) -> Option<Changed> {
    let mirror = Mat4::from_scale(vec3(-1.0, 1.0, 1.0));
    let mut changed = carried(scene, mirror, mirror);
    if let Some(environment) = &mut changed.scene.environment {
        *environment = reflected(environment);
    }
    changed.is_mirrored = true;
    Some(changed)
}

/// An environment that is not rotated, with -X in the place of +X.
fn reflected(environment: &Environment) -> Environment {
    assert_eq!(environment.rotation, glam::Quat::IDENTITY);
    let Pixels::Rgba32Float(texels) = &environment.image.pixels else {
        panic!("texels of another type");
    };
    let rows = texels.chunks_exact(4 * environment.image.width as usize);
    let texels = rows.flat_map(|row| row.as_chunks::<4>().0.iter().rev().flatten().copied());
    let image = Image {
        pixels: Pixels::Rgba32Float(texels.collect()),
        ..Image::clone(&environment.image)
    };
    Environment {
        image: Arc::new(image),
        ..environment.clone()
    }
}

/// The mesh after an affine transform, with its fronts where they were.
fn transformed(mesh: &Mesh, matrix: &Mat4) -> Mesh {
    let mut mesh = mesh.clone();
    let linear = Mat3::from_mat4(*matrix);
    let normals = linear.inverse().transpose();
    for position in &mut mesh.positions {
        *position = matrix.transform_point3(*position);
    }
    for normal in &mut mesh.normals {
        *normal = (normals * *normal).normalize();
    }
    if linear.determinant() < 0.0 {
        mesh.indices
            .as_chunks_mut::<3>()
            .0
            .iter_mut()
            .for_each(|[_, b, c]| std::mem::swap(b, c));
    }
    mesh
}

/// Each instance with a mesh of its own, in a space `new_from_mesh`.
fn remade(scene: &Scene, new_from_mesh: impl Fn(&Instance) -> Mat4) -> Changed {
    let mut changed = scene.clone();
    changed.meshes.clear();
    for instance in &mut changed.instances {
        let matrix = new_from_mesh(instance);
        let mesh = transformed(&scene.meshes[instance.mesh], &matrix);
        instance.mesh = changed.meshes.len();
        instance.world_from_mesh *= matrix.inverse();
        changed.meshes.push(mesh.into());
    }
    Changed::in_place(changed)
}

/// With other meshes of the same shapes.
fn reshaped(scene: &Scene, reshape: impl Fn(&Mesh) -> Mesh) -> Changed {
    let mut changed = scene.clone();
    for mesh in &mut changed.meshes {
        *mesh = reshape(mesh).into();
    }
    Changed::in_place(changed)
}

/// One instance for all of one material, or of materials that are alike but for their names.
fn merged(scene: &Scene) -> Option<Changed> {
    let kind_of = |instance: &Instance| {
        let nameless = |index: usize| Material {
            name: String::new(),
            ..scene.materials[index].clone()
        };
        let this = nameless(instance.material);
        (0..instance.material)
            .find(|&other| nameless(other) == this)
            .unwrap_or(instance.material)
    };
    let mut parts = BTreeMap::<usize, Vec<Mesh>>::new();
    for instance in &scene.instances {
        let mesh = transformed(&scene.meshes[instance.mesh], &instance.world_from_mesh);
        parts.entry(kind_of(instance)).or_default().push(mesh);
    }
    if parts.len() == scene.instances.len() {
        return None;
    }
    let mut changed = scene.clone();
    changed.instances.clear();
    changed.meshes.clear();
    for (material, parts) in parts {
        let mesh = changed.add_mesh(join("merged", parts));
        changed.add_instance("merged", mesh, material, Mat4::IDENTITY);
    }
    Some(Changed::in_place(changed))
}

/// Two instances for each, of every other triangle.
fn split(scene: &Scene) -> Option<Changed> {
    let mut changed = scene.clone();
    changed.instances.clear();
    changed.meshes.clear();
    for instance in &scene.instances {
        let mesh = &scene.meshes[instance.mesh];
        for half in 0..2 {
            let triangles = mesh.indices.as_chunks::<3>().0.iter();
            let vertices: Vec<u32> = triangles.skip(half).step_by(2).flatten().copied().collect();
            let count = vertices.len() as u32;
            let part = mesh.with_vertices(&vertices, (0..count).collect());
            let part = changed.add_mesh(part);
            changed.add_instance("half", part, instance.material, instance.world_from_mesh);
        }
    }
    Some(Changed::in_place(changed))
}

fn is_solid(material: &Material) -> bool {
    material.emissive == Vec3::ZERO && material.transmission == 0.0
}

/// All that is opaque and does not emit twice in the same place.
fn doubled(scene: &Scene) -> Option<Changed> {
    let mut changed = scene.clone();
    let mut twins = scene.instances.clone();
    twins.retain(|twin| is_solid(&scene.materials[twin.material]));
    changed.instances.extend(twins);
    Some(Changed::with_more(changed, scene))
}

/// Each matt face with another that faces the other way: walls of no thickness, and solids with an inside.
fn backed(scene: &Scene) -> Option<Changed> {
    let mut changed = scene.clone();
    for instance in &scene.instances {
        let material = &scene.materials[instance.material];
        if is_solid(material) && material.metallic == 0.0 && !material.has_two_sides() {
            let back = inside_out(Mesh::clone(&scene.meshes[instance.mesh]));
            let back = changed.add_mesh(back);
            changed.add_instance("back", back, instance.material, instance.world_from_mesh);
        }
    }
    Some(Changed::with_more(changed, scene))
}

/// Each triangle as four.
fn subdivided(mesh: &Mesh) -> Mesh {
    let mut fine = mesh.with_vertices(&mesh.indices, Vec::new());
    for first in (0..mesh.indices.len() as u32).step_by(3) {
        let middle = fine.positions.len() as u32;
        for (a, b) in [(0, 1), (1, 2), (2, 0)] {
            let [a, b] = [a, b].map(|corner| (first + corner) as usize);
            fine.positions
                .push((fine.positions[a] + fine.positions[b]) / 2.0);
            fine.normals
                .push((fine.normals[a] + fine.normals[b]).normalize());
            if !fine.uvs[0].is_empty() {
                let uv = (fine.uvs[0][a] + fine.uvs[0][b]) / 2.0;
                fine.uvs[0].push(uv);
            }
        }
        let [ab, bc, ca] = [middle, middle + 1, middle + 2];
        let corners = [
            [first, ab, ca],
            [ab, first + 1, bc],
            [ca, bc, first + 2],
            [ab, bc, ca],
        ];
        fine.indices.extend(corners.as_flattened());
    }
    fine
}

/// Everything in the opposite order.
fn reversed(scene: &Scene) -> Option<Changed> {
    let mut changed = reshaped(scene, |mesh| {
        let triangles = mesh.indices.as_chunks::<3>().0.iter().rev();
        Mesh {
            indices: triangles.flatten().copied().collect(),
            ..mesh.clone()
        }
    });
    let scene = &mut changed.scene;
    scene.meshes.reverse();
    scene.materials.reverse();
    scene.instances.reverse();
    scene.lights.reverse();
    for instance in &mut scene.instances {
        instance.mesh = scene.meshes.len() - 1 - instance.mesh;
        instance.material = scene.materials.len() - 1 - instance.material;
    }
    Some(changed)
}

/// A box of a centimetre in a distance of 100 km.
fn far_away(scene: &Scene) -> Option<Changed> {
    let mut changed = scene.clone();
    let tiny = cuboid(Vec3::ZERO, Vec3::splat(0.01), 1);
    let stray = place(&mut changed, tiny, Material::matt("stray", Vec3::ONE));
    changed.instances[stray].world_from_mesh = Mat4::from_translation(Vec3::X * 1e5);
    Some(Changed::with_more(changed, scene))
}

/// A far larger ground below the scene, where nothing is seen and no light goes.
fn on_ground(scene: &Scene) -> Option<Changed> {
    if scene.environment.is_some() {
        return None;
    }
    let mut changed = scene.clone();
    let bounds = scene.bounds();
    let half = 30.0 * bounds.diagonal();
    let below = bounds.center().with_y(bounds.min.y - 0.1);
    let ground = quad(
        below + vec3(-half, 0.0, half),
        Vec3::X * 2.0 * half,
        Vec3::NEG_Z * 2.0 * half,
        1,
    );
    place(&mut changed, ground, Material::matt("ground", Vec3::ZERO));
    Some(Changed::with_more(changed, scene))
}

/// Each light as two of half the intensity.
fn two_lights(scene: &Scene) -> Option<Changed> {
    if scene.lights.is_empty() {
        return None;
    }
    let mut changed = scene.clone();
    for light in &mut changed.lights {
        light.intensity *= 0.5;
    }
    changed.lights.extend(changed.lights.clone());
    Some(Changed::in_place(changed))
}

/// Base colours in vertices instead of materials.
fn colored(scene: &Scene) -> Changed {
    let mut changed = remade(scene, |_| Mat4::IDENTITY);
    for instance in &changed.scene.instances {
        let color = scene.materials[instance.material].base_color;
        let mesh = Arc::make_mut(&mut changed.scene.meshes[instance.mesh]);
        mesh.colors = vec![color; mesh.positions.len()];
    }
    for material in &mut changed.scene.materials {
        material.base_color = Vec4::ONE;
    }
    changed
}
