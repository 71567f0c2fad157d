//! How alpha affects texels.

use std::sync::Arc;

use glam::{Mat4, Vec2, Vec3};
use gpugi_scene::{AlphaMode, Image, Material, Mesh, Pixels, Scene, Texture, TextureRef, Wrap};

use super::super::AtlasCaptureOptions;
use super::{atlas, captured};
use crate::testing::test_gpu;

/// A square of 2 m whose right half has an alpha of 51 of 255 and whose left half has 153, beside an opaque square.
fn two_alphas(alpha_mode: AlphaMode) -> Scene {
    let mut scene = Scene::new("alpha");
    scene.images.push(Arc::new(Image {
        name: "alpha".to_owned(),
        width: 2,
        height: 1,
        pixels: Pixels::Rgba8(vec![255, 255, 255, 153, 255, 255, 255, 51]),
    }));
    scene.textures.push(Texture {
        image: 0,
        wrap: [Wrap::ClampToEdge; 2],
        nearest: true,
        has_levels: true,
    });
    let square = Mesh {
        positions: [[-1.0, -1.0], [1.0, -1.0], [-1.0, 1.0], [1.0, 1.0]]
            .map(|[x, y]| Vec3::new(x, y, 0.0))
            .to_vec(),
        normals: vec![Vec3::Z; 4],
        uvs: [vec![Vec2::Y, Vec2::ONE, Vec2::ZERO, Vec2::X], Vec::new()],
        indices: vec![0, 1, 2, 2, 1, 3],
        ..Mesh::default()
    };
    let mesh = scene.add_mesh(square);
    let cut_out = scene.add_material(Material {
        base_color_texture: Some(TextureRef::new(0)),
        alpha_mode,
        ..Material::matt("cut out", Vec3::splat(0.5))
    });
    let opaque = scene.add_material(Material {
        base_color_texture: Some(TextureRef::new(0)),
        ..Material::matt("opaque", Vec3::splat(0.5))
    });
    scene.add_instance("cut out", mesh, cut_out, Mat4::IDENTITY);
    let beside = Mat4::from_translation(Vec3::X * 3.0);
    scene.add_instance("opaque", mesh, opaque, beside);
    scene
}

#[test]
fn what_is_cut_out_has_no_area() {
    let Some(gpu) = test_gpu() else { return };
    for (mode, shares) in [
        (AlphaMode::Opaque, [1.0, 1.0]),
        (AlphaMode::Mask { cutoff: 0.5 }, [1.0, 0.0]),
        (AlphaMode::Mask { cutoff: 0.1 }, [1.0, 1.0]),
        (AlphaMode::Blend, [0.6, 0.2]),
    ] {
        let scene = two_alphas(mode);
        let atlas = atlas(&scene, 64);
        let points = captured(&gpu, &scene, &atlas, &AtlasCaptureOptions::default());
        let area = |instance: u32, side: fn(f32) -> bool| -> f32 {
            let points = points.iter().filter(|point| point.instance == instance);
            points
                .filter(|point| side(point.position.x))
                .map(|point| point.area)
                .sum()
        };
        for (found, share) in [area(0, |x| x < 0.0), area(0, |x| x >= 0.0)]
            .iter()
            .zip(shares)
        {
            // A texel on the border belongs to one side.
            assert!((found - 2.0 * share).abs() < 0.15, "{mode:?}: {found} m^2");
        }
        assert!((area(1, |_| true) - 4.0).abs() < 1e-3);

        let alpha = super::super::alpha(&gpu, &scene, &atlas).unwrap();
        let Some(alpha) = alpha else {
            assert_eq!(mode, AlphaMode::Opaque);
            continue;
        };
        assert_eq!(alpha.len(), points.len());
        for (point, alpha) in points.iter().zip(&alpha) {
            let expected = match (point.instance, point.position.x) {
                (1, _) => 1.0,
                (0, x) if x < -0.1 => 0.6,
                (0, x) if x > 0.1 => 0.2,
                _ => continue,
            };
            assert!((alpha - expected).abs() < 1e-3, "{alpha} at {point:?}");
        }
        assert!(alpha.iter().all(|alpha| *alpha > 0.19));
    }
}
