//! A top level that the GPU has refitted, against a new one.

use glam::{Mat4, Quat, Vec3};
use gpugi_scene::builtin::shapes;
use gpugi_scene::bvh::Row;
use gpugi_scene::bvh::traverse::{Hit, Ray, closest_hit};
use gpugi_scene::{Material, Scene};

use super::ray_tests::trace;
use super::{Edit, GpuScene};
use crate::gpu::{Gpu, read_buffer};
use crate::testing::{Random, test_gpu};

const COUNT: usize = 300;

fn vector(random: &mut Random) -> Vec3 {
    Vec3::from_array([0; 3].map(|_| (random.next() * 2.0 - 1.0) as f32))
}

/// Small cubes around the origin, turned this way and that.
fn scattered(scale: f32, random: &mut Random) -> Scene {
    let mut scene = Scene::new("cubes");
    let cube = scene.add_mesh(shapes::cuboid(Vec3::splat(-0.5), Vec3::splat(0.5), 1));
    let material = scene.add_material(Material::default());
    for _ in 0..COUNT {
        scene.add_instance("", cube, material, placed(scale, 1.0, random));
    }
    scene
}

fn placed(scale: f32, reach: f32, random: &mut Random) -> Mat4 {
    let turn = Quat::from_scaled_axis(vector(random) * 3.0);
    Mat4::from_translation(vector(random) * scale * reach)
        * Mat4::from_quat(turn)
        * Mat4::from_scale(Vec3::splat(scale * 0.1))
}

/// What the CPU twin of the traversal finds in the rows on the GPU.
fn hits(gpu: &Gpu, scene: &GpuScene, rays: &[Ray]) -> Vec<Option<Hit>> {
    let hierarchy = scene.rays.as_ref().unwrap();
    let rows: Vec<Row> = read_buffer(gpu, &hierarchy.buffer, hierarchy.buffer.size()).unwrap();
    let hit = |ray| closest_hit(&rows, hierarchy.start(), ray, |_, _, _| true).hit;
    rays.iter().map(hit).collect()
}

#[test]
fn rays_find_in_a_refitted_top_level_what_they_find_in_a_new_one() {
    let Some(gpu) = test_gpu() else { return };
    let mut random = Random(7);
    for scale in [1e-6, 1.0, 1e9] {
        let mut scene = scattered(scale, &mut random);
        let mut on_gpu = GpuScene::with_rays(&gpu, &scene).unwrap();
        // One that leaves the others far behind; some; one that comes back, by two edits; all, twice, so that the tree
        // is built again.
        let every = |step| (0..COUNT).step_by(step).collect::<Vec<_>>();
        for (moved, reach) in [
            (vec![0], 50.0),
            (every(7), 2.0),
            (vec![0, 0], 1.0),
            (every(1), 2.0),
            (every(1), 1.0),
        ] {
            for &index in &moved {
                let world_from_mesh = placed(scale, reach, &mut random);
                scene.instances[index].world_from_mesh = world_from_mesh;
                let edit = Edit::Instance {
                    index,
                    world_from_mesh,
                };
                if moved.len() < 3 {
                    on_gpu.edit(&gpu, &[edit]).unwrap();
                }
            }
            on_gpu.update(&gpu, &scene).unwrap();
            let new = GpuScene::with_rays(&gpu, &scene).unwrap();
            let rays: Vec<Ray> = (0..600)
                .map(|number| {
                    // Half of them at an instance.
                    let aim = scene.instances[number % COUNT].world_from_mesh.w_axis;
                    let origin = vector(&mut random) * scale * 4.0;
                    let at = if number < COUNT {
                        aim.truncate()
                    } else {
                        vector(&mut random) * scale
                    };
                    Ray {
                        origin,
                        t_min: 0.0,
                        direction: at - origin,
                        t_max: f32::MAX,
                    }
                })
                .collect();
            let [found, expected] = [&on_gpu, &new].map(|scene| hits(&gpu, scene, &rays));
            let mut count = 0;
            for (number, (found, expected)) in found.iter().zip(&expected).enumerate() {
                let [found, expected] =
                    [found, expected].map(|hit| hit.map(|hit| (hit.t, hit.instance)));
                assert_eq!(
                    found,
                    expected,
                    "ray {number} at scale {scale}, {} moved",
                    moved.len()
                );
                count += usize::from(found.is_some());
            }
            assert!(count > 250, "{count} hits");
            // The shader agrees.
            let traced = trace(&gpu, &on_gpu, &rays).into_iter();
            let instances =
                traced.map(|found| (found.instance != u32::MAX).then_some(found.instance));
            let expected = expected.iter().map(|hit| hit.map(|hit| hit.instance));
            let differ = instances.zip(expected).filter(|(a, b)| a != b).count();
            assert!(differ <= 2, "{differ} at scale {scale}");
        }
    }
}
