//! Materials that are exported and read back.

use glam::{Vec3, Vec4};
use gpugi_scene::export::export_scene;
use gpugi_scene::material::Volume;
use gpugi_scene::{AlphaMode, Limits, Material, MaterialModel, import};

use crate::random::Random;
use crate::untrusted::files::{Nothing, shown};

/// What an exported material reflects is what it reflected, for random materials of every model.
#[test]
fn exported_materials_read_back() {
    let mut random = Random(11);
    let mut part = move || random.below(1001) as f32 / 1000.0;
    for case in 0..3000 {
        let mut color = || Vec3::new(part(), part(), part());
        let (kd, tint, n, k) = (color(), color(), color(), color());
        let ks = color() * (Vec3::ONE - kd);
        let emissive = color() * if case % 2 == 0 { 10.0 } else { 0.0 };
        let mut material = Material {
            name: "one".into(),
            model: match case % 3 {
                0 => MaterialModel::MetallicRoughness,
                1 => MaterialModel::Phong {
                    kd: if case % 5 == 0 {
                        Vec3::new(kd.x, 0.0, 0.0)
                    } else {
                        kd
                    },
                    ks: if case % 7 == 0 { Vec3::ONE - kd } else { ks },
                    shininess: 300.0 * part(),
                },
                _ => MaterialModel::Conductor {
                    n: n + 0.01,
                    k: k * 5.0,
                },
            },
            base_color: tint.extend(1.0),
            metallic: part(),
            roughness: part(),
            emissive,
            double_sided: case % 4 == 0,
            ..Material::default()
        };
        if case % 3 == 0 {
            material.ior = 1.0 + part();
            material.specular = part();
            material.transmission = part();
            material.diffuse_transmission = part();
            material.volume = Some(Volume {
                attenuation_distance: 0.1 + part(),
                attenuation_color: kd,
            });
            material.alpha_mode = AlphaMode::Mask { cutoff: part() };
        }
        let file = export_scene(&shown(material.clone())).unwrap();
        let read = import("a.glb", &file.glb, &Nothing, &Limits::default());
        let read = read.unwrap_or_else(|error| panic!("{error}: {material:?}"));
        assert_eq!(read.warnings, Vec::<String>::new(), "{material:?}");
        let found = &read.materials[0];
        let close =
            |a: Vec3, b: Vec3| (a - b).abs().max_element() <= 2e-6 * (1.0 + a.max_element());
        match (material.model, found.model) {
            (
                MaterialModel::Phong { kd, ks, shininess },
                MaterialModel::Phong {
                    kd: found_kd,
                    ks: found_ks,
                    shininess: found_shininess,
                },
            ) => {
                let albedo = |color: Vec4, kd: Vec3| color.truncate() * kd;
                let [a, b] = [
                    albedo(material.base_color, kd),
                    albedo(found.base_color, found_kd),
                ];
                assert!(close(a, b) && ks == found_ks, "{material:?} {found:?}");
                assert_eq!(shininess, found_shininess);
            }
            (MaterialModel::Conductor { .. }, _) => assert_eq!(material.model, found.model),
            _ => {
                assert_eq!(material.model, found.model);
                assert_eq!(material.base_color, found.base_color);
                assert_eq!(material.metallic, found.metallic);
            }
        }
        assert!(
            close(material.emissive, found.emissive),
            "{material:?} {found:?}"
        );
        assert_eq!(
            (
                material.roughness,
                material.ior,
                material.specular,
                material.transmission,
                material.diffuse_transmission
            ),
            (
                found.roughness,
                found.ior,
                found.specular,
                found.transmission,
                found.diffuse_transmission
            )
        );
        assert_eq!(
            (material.alpha_mode, material.volume),
            (found.alpha_mode, found.volume)
        );
    }
}
