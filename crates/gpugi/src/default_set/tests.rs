use glam::{Mat4, Vec3};
use gpugi_scene::Mesh;
use gpugi_scene::builtin::{SCENES, builtin};

use super::*;
use crate::Renderer;
use crate::light_paths::in_words;
use crate::scene::{has_emitters, has_glossy_objects, stand_apart};
use crate::techniques::occasion::{MOST_IN_TEXELS, MOST_PIECES, MOST_TRACED, MOST_UNWRAPPED};
use crate::techniques::{
    Speed, caustics, distance_impostor, final_gather, image_based_lighting, participating_media,
    path_tracing, radiosity, ray_tracing, shadow_map,
};
use crate::testing::test_gpu;

const CAUSTICS: &str = caustics::INFO.name;
const IMPOSTORS: &str = distance_impostor::INFO.name;
const RAY_TRACING: &str = ray_tracing::INFO.name;
const RADIOSITY: &str = radiosity::INFO.name;
const SHADOWS: &str = shadow_map::INFO.name;
const SKY: &str = image_based_lighting::INFO.name;
const FINAL_GATHER: &str = final_gather::INFO.name;
const MEDIA: &str = participating_media::INFO.name;

/// What each scene has for a still picture beside shadow-map and radiosity.
#[test]
fn sets_are_valid_and_hold_indirect_light_in_every_scene() {
    let Some(gpu) = test_gpu() else { return };
    let registry = Registry::default();
    for listed in SCENES {
        let scene = builtin(listed.name, 1).unwrap();
        let set = |purpose| default_set(&scene, &gpu.adapter, purpose, &registry);
        let [still, bake] = [Purpose::StillPicture, Purpose::Bake].map(set);
        // On discrete GPUs, paths may take the place of the others.
        let modest = AdapterSummary {
            device_type: wgpu::DeviceType::IntegratedGpu,
            ..gpu.adapter.clone()
        };
        let live = default_set(&scene, &modest, Purpose::LiveView, &registry);
        assert!(still.notes.is_empty(), "{}: {:?}", listed.name, still.notes);
        let (gather, direct) = live.choices.split_last().unwrap();
        for choice in direct {
            let is_shared = choice.technique == SHADOWS && has_emitters(&scene);
            let names: Vec<&str> = choice.settings.iter().map(|(name, _)| *name).collect();
            let expected: &[&str] = match choice.technique {
                "participating-media" => &["steps", "shadow-rays"],
                _ if is_shared => &["interleaved"],
                _ => &[],
            };
            assert_eq!(names, expected, "{}: {}", scene.name, choice.technique);
        }
        assert_eq!(gather.technique, FINAL_GATHER);
        let mut expected = live.names();
        *expected.last_mut().unwrap() = RADIOSITY.to_owned();
        let has_media = expected.contains(&MEDIA.to_owned());
        assert_eq!(has_media, !scene.media.is_empty(), "{}", listed.name);
        let in_texels = expected.iter().filter(|name| *name != MEDIA);
        assert_eq!(bake.names(), in_texels.cloned().collect::<Vec<_>>());
        if has_glossy_objects(&scene) {
            expected.retain(|name| name != IMPOSTORS);
            expected.insert(expected.len() - 1, RAY_TRACING.to_owned());
        }
        assert_eq!(still.names(), expected);
        let has_settings = |name| {
            let choice = still.choices.iter().find(|choice| choice.technique == name);
            choice.is_some_and(|choice| !choice.settings.is_empty())
        };
        let is_soft = has_emitters(&scene) || scene.lights.iter().any(|light| light.radius > 0.0);
        let is_fast = Speed::of(&gpu.adapter) == Speed::Fast;
        assert!(is_fast || has_settings(SHADOWS) == is_soft);
        assert_eq!(has_settings(SKY), scene.environment.is_some());
        assert_eq!(has_settings(RAY_TRACING), has_glossy_objects(&scene));
        assert_eq!(has_settings(MEDIA), has_media && stand_apart(&scene));
        // Refused if light paths overlap, or if a setting does not exist.
        let size = [8, 8];
        let renderer = Renderer::new(&gpu, &scene, size, &still).unwrap();
        let classes = renderer.light_classes();
        assert_eq!(
            classes,
            Occasion::new(&scene, &gpu.adapter, Purpose::StillPicture).classes,
            "{}",
            listed.name
        );
        let words = in_words(&renderer.light_paths(), &classes);
        let is_told = |what: &str| words.iter().any(|phrase| phrase.starts_with(what));
        assert!(is_told("direct light on diffuse surfaces"), "{words:?}");
        assert!(
            is_told("light reflected between diffuse surfaces"),
            "{words:?}"
        );
        let objects = &renderer.scene().objects;
        let is_smooth = objects.iter().any(|object| object.is_smooth);
        let is_rough = objects
            .iter()
            .any(|object| !object.is_smooth && !object.is_diffuse);
        for (what, is_there) in [("mirrors", is_smooth), ("gloss", is_rough)] {
            let words_of = format!("lit surroundings seen in {what}");
            assert_eq!(is_told(&words_of), is_there, "{}: {words:?}", listed.name);
        }
    }
}

/// Live views of discrete GPUs trace paths where that was measured to win, beside what paths cannot find.
#[test]
fn live_views_trace_paths_where_that_wins() {
    let Some(gpu) = test_gpu() else { return };
    let registry = Registry::default();
    let discrete = AdapterSummary {
        device_type: wgpu::DeviceType::DiscreteGpu,
        ..gpu.adapter.clone()
    };
    let paths = path_tracing::INFO.name;
    for (name, expected) in [
        ("cornell", Some(&[paths][..])),
        ("window-room", Some(&[paths])),
        ("spheres", Some(&[paths])),
        ("glass-room", Some(&[CAUSTICS, paths])),
        ("room", Some(&[CAUSTICS, paths])),
        ("chamber", Some(&[paths])),
        ("fog-room", Some(&[CAUSTICS, paths, MEDIA])),
        ("cloud", None),
        ("station", None),
    ] {
        let scene = builtin(name, 1).unwrap();
        let set = |adapter, purpose| default_set(&scene, adapter, purpose, &registry);
        let live = set(&discrete, Purpose::LiveView);
        match expected {
            Some(names) => assert_eq!(live.names(), names, "{name}"),
            None => assert!(!live.names().contains(&paths.to_owned()), "{name}"),
        }
        Renderer::new(&gpu, &scene, [8, 8], &live).unwrap();
        let others = [
            set(&discrete, Purpose::StillPicture),
            set(&discrete, Purpose::Bake),
        ];
        for other in others {
            assert!(!other.names().contains(&paths.to_owned()), "{name}");
        }
        // Elsewhere they win in software alone, and with glass alone.
        for device_type in [wgpu::DeviceType::Cpu, wgpu::DeviceType::IntegratedGpu] {
            let adapter = AdapterSummary {
                device_type,
                ..gpu.adapter.clone()
            };
            let live = default_set(&scene, &adapter, Purpose::LiveView, &registry);
            let wins = device_type == wgpu::DeviceType::Cpu && name == "glass-room";
            let names = live.names();
            assert_eq!(names.contains(&paths.to_owned()), wins, "{name}");
        }
    }
}

#[test]
fn software_makes_smaller_maps() {
    let registry = Registry::default();
    let scene = builtin("window-room", 1).unwrap();
    let names = |technique: &str, triangles, speed| {
        let settings = registry.find(technique).unwrap().settings;
        let settings = settings(&Occasion {
            purpose: Purpose::StillPicture,
            scene: &scene,
            speed,
            triangles,
            classes: Vec::new(),
            has_rays: false,
            has_atlas: true,
        });
        let names = settings.into_iter().map(|(name, _)| name);
        names.collect::<Vec<_>>()
    };
    let many = 13_568;
    assert_eq!(
        names(SKY, many, Speed::Software),
        ["per-sample", "resolution"]
    );
    assert_eq!(names(SKY, 600, Speed::Software), ["per-sample"]);
    assert_eq!(names(SKY, many, Speed::Fast), ["per-sample"]);
    assert_eq!(names(CAUSTICS, many, Speed::Software), ["cube-resolution"]);
    assert_eq!(names(CAUSTICS, many, Speed::Fast), [""; 0]);
}

#[test]
fn large_gpus_trace_the_light_of_the_sky() {
    let Some(gpu) = test_gpu() else { return };
    let registry = Registry::default();
    let scene = builtin("window-room", 1).unwrap();
    let set = |device_type, purpose| {
        let adapter = AdapterSummary {
            device_type,
            ..gpu.adapter.clone()
        };
        default_set(&scene, &adapter, purpose, &registry)
    };
    let traces = |set: &DefaultSet| {
        let mut settings = set.choices.iter().flat_map(|choice| &choice.settings);
        settings.any(|(name, value)| (*name, value.as_str()) == ("visibility", "rays"))
    };
    let [discrete, software] = [wgpu::DeviceType::DiscreteGpu, wgpu::DeviceType::Cpu];
    let still = set(discrete, Purpose::StillPicture);
    assert!(traces(&still), "{still:?}");
    let glass = builtin("ornaments", 1).unwrap();
    let adapter = AdapterSummary {
        device_type: discrete,
        ..gpu.adapter.clone()
    };
    let of_glass = default_set(&glass, &adapter, Purpose::StillPicture, &registry);
    assert!(of_glass.names().contains(&SKY.to_owned()) && !traces(&of_glass));
    assert!(!traces(&set(discrete, Purpose::LiveView)));
    assert!(!traces(&set(software, Purpose::StillPicture)));
    // It runs on any adapter.
    Renderer::new(&gpu, &scene, [8, 8], &still).unwrap();
    let error = LightingError::Gpu(GpuError::Pass {
        pass: RADIOSITY.into(),
        reason: "no atlas".into(),
    });
    let without = still.without_atlas(&error, &scene, &adapter, Purpose::StillPicture, &registry);
    assert!(!traces(&without.unwrap()));
}

#[test]
fn rays_are_traced_in_scenes_that_bindings_hold() {
    let Some(gpu) = test_gpu() else { return };
    let of = |name, triangles| {
        let scene = builtin(name, 1).unwrap();
        let mut occasion = Occasion::new(&scene, &gpu.adapter, Purpose::StillPicture);
        occasion.triangles = triangles;
        let set = chosen(occasion, &Registry::default());
        let mut choices = set.choices.into_iter();
        let gloss = choices.find(|choice| [RAY_TRACING, IMPOSTORS].contains(&choice.technique));
        gloss.unwrap()
    };
    let names = [MOST_TRACED, MOST_TRACED + 1].map(|triangles| of("shapes", triangles).technique);
    assert_eq!(names, [RAY_TRACING, IMPOSTORS]);
    let has_split = |name| {
        of(name, 1)
            .settings
            .iter()
            .any(|(name, _)| *name == "split")
    };
    assert_eq!(["glass-room", "shapes"].map(has_split), [true, false]);
}

#[test]
fn final_gather_lights_what_takes_long_to_unwrap() {
    let Some(gpu) = test_gpu() else { return };
    let registry = Registry::default();
    let mut scene = builtin("cornell", 1).unwrap();
    // Copies share an unwrapping, but not texels.
    let triangles = scene.statistics().triangles;
    for copies in 1.. {
        let set = default_set(&scene, &gpu.adapter, Purpose::StillPicture, &registry);
        let now = scene.statistics().triangles;
        let expected = if now <= MOST_IN_TEXELS {
            RADIOSITY
        } else {
            FINAL_GATHER
        };
        assert_eq!(set.names(), ["shadow-map", expected], "{now} triangles");
        let told = if now <= MOST_IN_TEXELS {
            triangles
        } else {
            now
        };
        assert!(set.choices[1].reason.contains(&told.to_string()), "{set:?}");
        if now > MOST_IN_TEXELS {
            break;
        }
        let more = if copies == 1 {
            MOST_UNWRAPPED
        } else {
            MOST_IN_TEXELS
        };
        for _ in now / triangles..=more / triangles {
            scene.instances.extend_from_within(..8);
        }
    }
    // Meshes of their own do not.
    let mut apart = builtin("cornell", 1).unwrap();
    let fine = (0..=MOST_UNWRAPPED as u32).flat_map(|at| [at, at + 1, at + 2]);
    let mesh = apart.add_mesh(Mesh {
        positions: vec![Vec3::ZERO; MOST_UNWRAPPED as usize + 3],
        normals: vec![Vec3::Z; MOST_UNWRAPPED as usize + 3],
        indices: fine.collect(),
        ..Mesh::default()
    });
    apart.add_instance("fine", mesh, 0, Mat4::IDENTITY);
    let set = default_set(&apart, &gpu.adapter, Purpose::StillPicture, &registry);
    assert_eq!(set.names(), ["shadow-map", FINAL_GATHER]);
    assert!(set.choices[1].reason.contains("unwrapping"), "{set:?}");
    let bake = default_set(&scene, &gpu.adapter, Purpose::Bake, &registry);
    assert_eq!(bake.names(), ["shadow-map", RADIOSITY]);
    // Few triangles, but each a piece of its own.
    let mut leaves = builtin("cornell", 1).unwrap();
    let corners = 0..3 * (MOST_PIECES as u32 + 1);
    let apart = corners
        .clone()
        .map(|corner| Vec3::new(corner as f32, (corner % 3) as f32, 0.0));
    let mesh = leaves.add_mesh(Mesh {
        positions: apart.collect(),
        normals: vec![Vec3::Z; corners.len()],
        indices: corners.collect(),
        ..Mesh::default()
    });
    leaves.add_instance("leaves", mesh, 0, Mat4::IDENTITY);
    let set = default_set(&leaves, &gpu.adapter, Purpose::StillPicture, &registry);
    assert_eq!(set.names(), ["shadow-map", FINAL_GATHER]);
    // What only unwrapping tells.
    let cornell = builtin("cornell", 1).unwrap();
    let still = Purpose::StillPicture;
    let mut set = default_set(&cornell, &gpu.adapter, still, &registry);
    let without_atlas = |set: &DefaultSet, pass: &str| {
        let error = GpuError::Pass {
            pass: pass.into(),
            reason: "too large".into(),
        };
        set.without_atlas(&error.into(), &cornell, &gpu.adapter, still, &registry)
    };
    assert_eq!(without_atlas(&set, "radiosity.rays"), None);
    set = without_atlas(&set, RADIOSITY).unwrap();
    assert_eq!(set.names(), ["shadow-map", FINAL_GATHER]);
    assert!(set.notes[0].contains("too large"));
    // Nothing to light, nothing to light it with.
    let nothing = Scene::new("nothing");
    for purpose in [Purpose::StillPicture, Purpose::LiveView, Purpose::Bake] {
        let set = default_set(&nothing, &gpu.adapter, purpose, &registry);
        assert_eq!(set, DefaultSet::default());
    }
}

#[test]
fn still_pictures_are_traced_where_that_was_measured_to_win() {
    let Some(gpu) = test_gpu() else { return };
    let traces = |name, device_type| {
        let adapter = AdapterSummary {
            device_type,
            ..gpu.adapter.clone()
        };
        let still = StillPicture::of(&builtin(name, 1).unwrap(), &adapter);
        matches!(still, StillPicture::PathTracer { .. })
    };
    for name in ["cornell", "cloud", "fog-room"] {
        assert!(traces(name, wgpu::DeviceType::DiscreteGpu), "{name}");
        let in_software = traces(name, wgpu::DeviceType::Cpu);
        assert_eq!(in_software, name == "fog-room", "{name}");
        for other in [wgpu::DeviceType::IntegratedGpu, wgpu::DeviceType::Other] {
            assert!(!traces(name, other), "{name}, {other:?}");
        }
    }
}
