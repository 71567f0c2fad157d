//! Tests transfer matrices against closed forms, and that they may stop and continue anywhere.

use std::f32::consts::PI;

use glam::{Vec3, vec3};
use gpugi_scene::builtin::shapes::quad;
use gpugi_scene::{Material, MaterialModel, Scene};

use super::super::Glossy;
use super::{Solver, corner, scene_of, sky};
use crate::gpu::read_buffer;
use crate::techniques::{Resume, Technique};
use crate::testing::{own_test_gpu, test_gpu};

fn phong() -> Material {
    Material {
        model: MaterialModel::Phong {
            kd: Vec3::splat(0.3),
            ks: Vec3::splat(0.5),
            shininess: 20.0,
        },
        ..Material::default()
    }
}

/// The scene with a glossy object in the place of one of its objects.
fn with_glossy(mut scene: Scene, object: usize, material: Material) -> Scene {
    scene.materials[object] = material;
    scene.instances[object].name = "glossy".into();
    scene
}

impl Solver {
    fn glossy(&self) -> &Glossy {
        let made = self.transfer.texels.get().expect("texels");
        made.transfer.glossy.as_ref().expect("matrices")
    }

    fn matrices(&self) -> Vec<Vec<u32>> {
        self.glossy().save(&self.gpu).expect("matrices")
    }
}

/// Even light arrives at an unoccluded plane from the upper hemisphere: with the cosine, its coefficients of m = 0 are
/// sqrt((2 l + 1) / 4 pi) 2 pi times the integral of t P_l(t) from 0 to 1, without it that of P_l(t).
#[test]
fn even_light_on_a_plane_is_the_closed_form() {
    let Some(gpu) = test_gpu() else { return };
    let plane = quad(vec3(-1.0, 0.0, 1.0), Vec3::X * 2.0, Vec3::NEG_Z * 2.0, 1);
    let environment = Some(sky(16, 0, |_| Vec3::ONE));
    let scene = scene_of([plane], environment);
    let cosine = [1.0 / 2.0, 1.0 / 3.0, 1.0 / 8.0, 0.0, -1.0 / 48.0, 0.0];
    let even = [1.0, 1.0 / 2.0, 0.0, -1.0 / 8.0, 0.0, 1.0 / 16.0];
    let ggx = Material::metal("metal", Vec3::ONE, 0.4);
    for (material, integrals) in [(phong(), cosine), (ggx, even)] {
        let scene = with_glossy(scene.clone(), 0, material);
        let solver = Solver::new(&gpu, &scene, &[("glossy", "glossy")]).solve();
        let arriving = &solver.glossy().arriving;
        let words: Vec<u32> = read_buffer(&gpu, arriving, arriving.size()).unwrap();
        let half = |word: u32| half::f16::from_bits(word as u16).to_f32();
        let (mut worst, mut texels) = (0.0_f32, 0);
        for &first in &words[..32 * 32] {
            let first = first as usize;
            if first >= words.len() || half(words[first + 1] >> 16) != 1.0 {
                continue;
            }
            texels += 1;
            for index in 0..36 {
                let l = (index as f32).sqrt() as usize;
                let scale = 2.0 * PI * ((2 * l + 1) as f32 / (4.0 * PI)).sqrt();
                let is_zonal = index == l * (l + 1);
                let expected = if is_zonal { scale * integrals[l] } else { 0.0 };
                let found = half(words[first + 2 * index]);
                worst = worst.max((found - expected).abs());
            }
        }
        println!("{worst} at {texels} texels");
        assert!(texels > 500 && worst < 0.02, "{worst} at {texels} texels");
    }
}

/// The same bits, whenever the work stopped; matrices of other texels are refused.
#[test]
fn matrices_are_saved_and_resumed() {
    let Some(gpu) = test_gpu() else { return };
    let scene = with_glossy(corner(), 2, phong());
    let settings = [
        ("bounces", "2"),
        ("rays", "64"),
        ("order", "2"),
        ("glossy", "glossy"),
        ("steps", "1"),
    ];
    // Four tiles per bounce, of 256 texels each.
    let begun = || {
        let mut solver = Solver::new(&gpu, &scene, &settings);
        solver.transfer.cut.rays_of_step = 256 * 64;
        solver
    };
    let whole = begun().solve();
    let matrices = whole.matrices();
    assert!(matrices[0].iter().any(|&word| word != 0));
    let mut first = begun().with_atlas();
    // The tiles of vectors are done before those of matrices.
    let steps = 8 + whole.glossy().steps();
    assert!(steps > 9, "{steps}");
    for stop in [5, 8, 9] {
        while first.frame().progress < (stop as f32 - 0.5) / steps as f32 {}
        let saved = first.transfer.save(&gpu).unwrap().unwrap();
        let mut rest = begun().with_atlas();
        assert_eq!(rest.transfer.resume(&gpu, &saved), Ok(true));
        let rest = rest.solve();
        assert!(rest.matrices() == matrices, "from {stop} steps on");
        assert!(rest.vectors() == whole.vectors(), "from {stop} steps on");
    }
    let saved = whole.transfer.save(&gpu).unwrap().unwrap();
    let mut other = begun();
    other.transfer.settings_mut().set("glossy", "").unwrap();
    other.transfer.plan(&other.scene, &[], &[]);
    let mut other = other.with_atlas();
    let refused = other.transfer.resume(&gpu, &saved).unwrap_err();
    assert!(refused.to_string().contains("other matrices"), "{refused}");
}

#[test]
fn matrices_that_memory_does_not_hold_are_refused() {
    let Some(gpu) = own_test_gpu() else { return };
    let scene = with_glossy(corner(), 2, phong());
    let mut solver = Solver::new(&gpu, &scene, &[("glossy", "glossy"), ("rays", "1")]);
    // The first attempt without memory begins the atlas.
    gpu.limit_allocations(0);
    let _ = solver.try_frame();
    let is_of_matrices = |allocations| {
        gpu.limit_allocations(allocations);
        let refused = solver.try_frame().err().map(|error| error.to_string());
        refused.is_some_and(|reason| reason.contains("glossy texels take"))
    };
    // Each attempt gets one allocation further.
    assert!((0..200).any(is_of_matrices));
    gpu.limit_allocations(u64::MAX);
    assert!(solver.try_frame().is_ok());
}
