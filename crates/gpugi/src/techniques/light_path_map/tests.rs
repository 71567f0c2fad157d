//! Tests panes against closed forms, the choice of panes, and that progress may stop and continue anywhere.

use std::f32::consts::PI;

use glam::{Mat4, Vec2, Vec3, vec3};
use gpugi_scene::builtin::shapes::{cuboid, quad};
use gpugi_scene::image::unpack_rgb9e5;
use gpugi_scene::{Camera, Material, Mesh, Scene};

use super::LightPathMap;
use super::entries::{COLUMN, Entries, Entry};
use crate::capture::{CaptureKernels, Emission, View};
use crate::gpu::{Frame, Gpu, read_buffer};
use crate::scene::{Edit, GpuScene};
use crate::techniques::{Earlier, EarlierLight, Generated, Resume, Shared, Technique};
use crate::testing::{Point, read_points, settled, test_gpu};

/// A scene of matt meshes.
fn scene_of(meshes: impl IntoIterator<Item = (Mesh, f32)>) -> Scene {
    let mut scene = Scene::new("scene");
    for (mesh, albedo) in meshes {
        let mesh = scene.add_mesh(mesh);
        let material = scene.add_material(Material::matt("grey", Vec3::splat(albedo)));
        scene.add_instance("", mesh, material, Mat4::IDENTITY);
    }
    scene
}

/// A closed box of 2 x 1.5 x 2 m, seen from inside.
fn closed_box(albedo: f32) -> Scene {
    let mut mesh = cuboid(vec3(-1.0, 0.0, -1.0), vec3(1.0, 1.5, 1.0), 1);
    for triangle in mesh.indices.chunks_exact_mut(3) {
        triangle.swap(1, 2);
    }
    for normal in &mut mesh.normals {
        *normal = -*normal;
    }
    mesh.tangents.clear();
    scene_of([(mesh, albedo)])
}

/// A scene on the GPU and the technique alone.
struct Solver {
    gpu: Gpu,
    scene: GpuScene,
    technique: LightPathMap,
    emission: Emission,
    shared: Shared,
}

impl Solver {
    fn new(gpu: &Gpu, scene: &Scene, settings: &[(&str, &str)]) -> Self {
        let on_gpu = GpuScene::with_texels(gpu, scene).unwrap();
        let mut technique = LightPathMap::default();
        let defaults = [
            ("resolution", "32"),
            ("entries", "1024"),
            ("clusters", "16"),
            ("steps", "4096"),
        ];
        for (name, value) in defaults.iter().chain(settings) {
            technique.settings_mut().set(name, value).unwrap();
        }
        technique.plan(&on_gpu, &[], &[]);
        let kernels = CaptureKernels::new(gpu, &on_gpu).unwrap();
        Self {
            emission: Emission::new(gpu, &on_gpu).unwrap(),
            shared: Shared::new(gpu, &on_gpu, &kernels).unwrap(),
            gpu: gpu.clone(),
            scene: on_gpu,
            technique,
        }
    }

    /// One frame.
    fn frame(&mut self) -> Generated {
        self.scene.wait_for_atlas();
        let camera = Camera::look_at("", Vec3::ONE, Vec3::ZERO, 1.0);
        let view = View::new(&camera, [8, 8], Vec2::ZERO, 0, 0, 1.0);
        let mut frame = Frame::new(&self.gpu, false);
        self.scene.merge(&mut frame);
        let mut earlier = Earlier::unlimited(
            EarlierLight::new(&mut self.emission, &mut []),
            &mut self.shared,
        );
        let (technique, scene) = (&mut self.technique, &self.scene);
        let generated = technique.generate(&mut frame, scene, &view, &mut earlier);
        let generated = settled(generated).unwrap();
        frame.submit().unwrap();
        generated
    }

    /// Frames until all panes are final.
    fn solve(mut self) -> Self {
        while self.frame().progress < 1.0 {}
        self
    }

    /// The words of all panes, sheet by sheet.
    fn words(&self) -> Vec<u32> {
        let sheets = &self.technique.maps.get().unwrap().panes.sheets;
        let words = sheets.iter();
        words
            .flat_map(|sheet| read_buffer(&self.gpu, &sheet.words, sheet.words.size()).unwrap())
            .collect()
    }

    /// All texels.
    fn points(&self) -> Vec<Point> {
        let made = self.technique.maps.get().unwrap();
        let points = made.texels.capture.points();
        let points = points.flat_map(|points| read_points(&self.gpu, &self.scene, points));
        points.collect()
    }

    /// The texels that have points, with the red irradiance of the sum of all panes.
    fn sum(&self) -> Vec<(Point, f32)> {
        let panes = &self.technique.maps.get().unwrap().panes;
        let (texels, clusters) = (panes.texels, panes.points.entries.clusters());
        let words = self.words();
        let sum = &words[(texels * clusters) as usize..][..texels as usize];
        let points = self.points().into_iter();
        points
            .zip(sum.iter().map(|&word| unpack_rgb9e5(word).x))
            .filter(|(point, _)| point.instance != u32::MAX)
            .collect()
    }

    /// Irradiance of all texels for these weights of the clusters, with so many panes.
    fn lit(&mut self, weights: &[[f32; 4]], panes: u32) -> Vec<[f32; 4]> {
        let settings = self.technique.settings_mut();
        settings.set("panes", &panes.to_string()).unwrap();
        let settings = &self.technique.settings;
        let made = self.technique.maps.get().unwrap();
        self.gpu.write(&made.weights, 0, weights);
        let mut frame = Frame::new(&self.gpu, false);
        made.relight(&mut frame, settings).unwrap();
        frame.submit().unwrap();
        let irradiance = &made.irradiance.target.radiance;
        read_buffer(&self.gpu, irradiance, irradiance.size()).unwrap()
    }
}

/// Mean by area, and the largest deviation from `expected`, both relative to the mean of `expected`.
fn errors(texels: &[(Point, f32)], expected: impl Fn(&Point) -> f32) -> [f32; 2] {
    assert!(texels.len() > 200, "{} texels", texels.len());
    let mean = |value: &dyn Fn(&(Point, f32)) -> f32| {
        let weighted = texels.iter().map(|texel| texel.0.area * value(texel));
        weighted.sum::<f32>() / texels.iter().map(|texel| texel.0.area).sum::<f32>()
    };
    let scale = mean(&|texel| expected(&texel.0));
    let off = texels
        .iter()
        .map(|texel| (texel.1 - expected(&texel.0)).abs());
    [
        mean(&|texel| texel.1) / scale - 1.0,
        off.fold(0.0, f32::max) / scale,
    ]
}

/// In a closed box that is lit by 1 everywhere, surfaces of albedo rho receive rho / (1 - rho) from each other.
#[test]
fn a_closed_box_has_the_light_of_a_geometric_series() {
    let Some(gpu) = test_gpu() else { return };
    for albedo in [0.5, 0.8] {
        let solver = Solver::new(&gpu, &closed_box(albedo), &[]).solve();
        let [mean, worst] = errors(&solver.sum(), |_| albedo / (1.0 - albedo));
        println!("albedo {albedo}: {mean} more, at worst {worst}");
        assert!(mean.abs() < 0.01, "{mean}");
        assert!(worst < 0.1, "{worst}");
    }
}

/// A square overhead that is lit by 1 sends rho times its form factor, one corner at a time: 1 / (2 pi) (X / a atan
/// Y / a + Y / b atan X / b), a = sqrt(1 + X^2), b = sqrt(1 + Y^2), X and Y in heights.
#[test]
fn one_reflection_between_squares_is_their_form_factor() {
    let Some(gpu) = test_gpu() else { return };
    let (height, albedo) = (0.5, 0.6);
    let floor = quad(vec3(-0.5, 0.0, 0.5), Vec3::X, Vec3::NEG_Z, 1);
    let roof = quad(vec3(-0.5, height, -0.5), Vec3::X, Vec3::Z, 1);
    let scene = scene_of([(floor, albedo), (roof, albedo)]);
    let solver = Solver::new(&gpu, &scene, &[("depth", "0")]).solve();
    let corner = |x: f32, y: f32| {
        let (a, b) = ((1.0 + x * x).sqrt(), (1.0 + y * y).sqrt());
        (x / a * (y / a).atan() + y / b * (x / b).atan()) / (2.0 * PI)
    };
    let expected = |point: &Point| {
        let [x0, x1] = [-0.5, 0.5].map(|x| (x - point.position.x) / height);
        let [z0, z1] = [-0.5, 0.5].map(|z| (z - point.position.z) / height);
        albedo * (corner(x1, z1) - corner(x0, z1) - corner(x1, z0) + corner(x0, z0))
    };
    let [mean, worst] = errors(&solver.sum(), expected);
    println!("{mean} more, at worst {worst}");
    assert!(mean.abs() < 0.01 && worst < 0.02, "{mean} {worst}");
}

/// The irradiance of texels by depth maps is that by rays, but for texels at the edges of shadows.
#[test]
fn depth_maps_see_what_rays_see() {
    let Some(gpu) = test_gpu() else { return };
    let mut with_obstacle = closed_box(0.6);
    let block = cuboid(vec3(-0.6, 0.3, -0.6), vec3(0.5, 0.6, 0.4), 1);
    let mesh = with_obstacle.add_mesh(block);
    let material = with_obstacle.add_material(Material::matt("dark", Vec3::splat(0.2)));
    with_obstacle.add_instance("", mesh, material, Mat4::IDENTITY);
    for (name, scene) in [("box", closed_box(0.6)), ("obstacle", with_obstacle)] {
        // Some panes, so that shadows show.
        let [by_rays, by_maps] = ["rays", "maps"].map(|visibility| {
            let settings = [
                ("entries", "256"),
                ("clusters", "8"),
                ("visibility", visibility),
            ];
            let solver = Solver::new(&gpu, &scene, &settings).solve();
            let texels = solver.technique.maps.get().unwrap().panes.texels as usize;
            let areas: Vec<f32> = solver.points().iter().map(|point| point.area).collect();
            let panes = solver.words()[..8 * texels].to_vec();
            let lit = panes.iter().zip(areas.iter().cycle());
            lit.map(|(&word, area)| area * unpack_rgb9e5(word).x)
                .collect::<Vec<_>>()
        });
        let total: f32 = by_rays.iter().sum();
        let more = by_maps.iter().sum::<f32>() / total - 1.0;
        let pairs = by_rays.iter().zip(&by_maps);
        let off = pairs.map(|(a, b)| (a - b).abs()).sum::<f32>() / total;
        println!("{name}: {more} more, off by {off}");
        assert!(more.abs() < 0.01, "{name}: {more}");
        assert!(off < 0.02, "{name}: {off}");
    }
}

#[test]
fn entry_points_are_spread_by_area_and_clustered_by_place_and_side() {
    let large = quad(vec3(0.0, 0.0, 0.0), Vec3::X * 3.0, Vec3::NEG_Z, 1);
    let small = quad(vec3(0.0, 2.0, 0.0), Vec3::X, Vec3::Z, 4);
    let scene = scene_of([(large, 0.5), (small, 0.5)]);
    let found = Entries::new(&scene, 1024, 3072, 16);
    assert_eq!(found.clusters(), 16);
    assert!((found.area - 4.0 / 1024.0).abs() < 1e-6);
    let on_large = found.entries.iter().filter(|entry| entry.instance == 0);
    assert_eq!(on_large.count(), 768);
    // A quarter of the large quad has a quarter of its points.
    let is_left = |entry: &&super::entries::Entry| entry.instance == 0 && entry.position.x < 0.75;
    let left = found.entries.iter().filter(is_left).count();
    assert!((190..=194).contains(&left), "{left}");
    assert_eq!(found.samples.len(), 3072);
    assert_eq!(found.first_samples.len(), 17);
    for (cluster, ends) in found.first_samples.windows(2).enumerate() {
        let [first, end] = [ends[0], ends[1]].map(|point| point as usize);
        assert!(first >= 1024 && first < end, "{first} {end}");
        let entry = found.entries[found.firsts[cluster] as usize];
        for sample in &found.samples[first - 1024..end - 1024] {
            assert_eq!(sample.instance, entry.instance);
            assert!(sample.position.distance(entry.position) < 1.1);
        }
    }
    for (entry, cluster) in found.with_clusters() {
        let first = found.firsts[cluster as usize] as usize;
        let of_cluster = &found.entries[first];
        assert_eq!(entry.instance, of_cluster.instance);
        assert!(entry.position.distance(of_cluster.position) < 1.1);
        let up = if entry.instance == 0 { 1.0 } else { -1.0 };
        assert!((entry.normal.y - up).abs() < 1e-6);
    }
    assert_eq!(Entries::new(&Scene::new(""), 64, 64, 4).clusters(), 0);
}

/// Columns of transfer decide the clusters, wherever their points are, and light samples follow.
#[test]
fn entry_points_are_clustered_by_columns() {
    let large = quad(vec3(0.0, 0.0, 0.0), Vec3::X * 3.0, Vec3::NEG_Z, 1);
    let small = quad(vec3(0.0, 2.0, 0.0), Vec3::X, Vec3::Z, 4);
    let scene = scene_of([(large, 0.5), (small, 0.5)]);
    let mut found = Entries::new(&scene, 512, 1536, 2);
    let is_left = |entry: &Entry| entry.position.x < 1.0;
    let column = |entry: &Entry| [f32::from(is_left(entry)); COLUMN];
    let columns: Vec<_> = found.entries.iter().map(column).collect();
    found.cluster_by(&columns);
    assert_eq!(found.clusters(), 2);
    let sides: Vec<bool> = (found.firsts.windows(2))
        .map(|ends| {
            let entries = &found.entries[ends[0] as usize..ends[1] as usize];
            assert!(!entries.is_empty());
            assert!(
                entries
                    .iter()
                    .all(|entry| is_left(entry) == is_left(&entries[0]))
            );
            is_left(&entries[0])
        })
        .collect();
    assert_ne!(sides[0], sides[1]);
    for (ends, side) in found.first_samples.windows(2).zip(sides) {
        let samples = &found.samples[ends[0] as usize - 512..ends[1] as usize - 512];
        let stray = samples.iter().filter(|sample| is_left(sample) != side);
        assert!(stray.count() * 20 < samples.len());
    }
}

/// Clusters by transfer hold the same light as those by place.
#[test]
fn clusters_by_transfer_hold_the_same_light() {
    let Some(gpu) = test_gpu() else { return };
    let mean = |clustering| {
        let settings = [
            ("entries", "256"),
            ("clusters", "8"),
            ("clustering", clustering),
        ];
        let solver = Solver::new(&gpu, &closed_box(0.5), &settings).solve();
        let [mean, _] = errors(&solver.sum(), |_| 1.0);
        let entries = &solver.technique.maps.get().unwrap().panes.points.entries;
        (mean, entries.firsts.clone())
    };
    let [by_place, by_transfer] = ["kmeans", "transfer"].map(mean);
    println!("{by_place:?} {by_transfer:?}");
    assert!(by_place.0.abs() < 0.015 && by_transfer.0.abs() < 0.015);
    assert!(by_place.1 != by_transfer.1 && by_transfer.1.len() == 9);
}

/// Weights of 32 clusters that differ.
fn uneven_weights(round: usize) -> Vec<[f32; 4]> {
    let weight = |cluster: usize| {
        let phase = cluster as f32 * 0.7 + round as f32 * 0.01;
        let light = phase.sin().max(0.0);
        [light, 2.0 * light, 0.5 * light, 0.0]
    };
    (0..32).map(weight).collect()
}

/// What the panes that a tile leaves out put in the wrong place of it stays below a bound; the power of each tile is
/// exact.
#[test]
fn tiles_leave_out_panes_up_to_a_bound() {
    let Some(gpu) = test_gpu() else { return };
    let settings = [("clusters", "32"), ("left-out", "0")];
    let mut solver = Solver::new(&gpu, &closed_box(0.6), &settings).solve();
    let areas: Vec<f32> = solver.points().iter().map(|point| point.area).collect();
    let weights = uneven_weights(0);
    let all = solver.lit(&weights, 0);
    let mut before = 33.0;
    for bound in [0.005_f32, 0.02, 0.1] {
        let settings = solver.technique.settings_mut();
        settings.set("left-out", &bound.to_string()).unwrap();
        let few = solver.lit(&weights, 0);
        for tile in 0..16 {
            let (mut light, mut found, mut wrong) = (0.0, 0.0, 0.0);
            for lane in 0..64 {
                let texel = (tile / 4 * 8 + lane / 8) * 32 + tile % 4 * 8 + lane % 8;
                let [exact, short] = [&all, &few].map(|lit| areas[texel] * lit[texel][1]);
                if all[texel][3] > 0.0 {
                    light += exact;
                    found += short;
                    wrong += (exact - short).abs();
                }
            }
            // Panes are off by up to 1/512.
            assert!(wrong <= (bound + 0.003) * light, "{bound} {wrong} {light}");
            assert!((found - light).abs() <= 0.003 * light, "{found} {light}");
        }
        let slots = &solver.technique.maps.get().unwrap().slots;
        let slots: Vec<[u32; 4]> = read_buffer(&gpu, slots, 16 * 33 * 16).unwrap();
        let added = slots.chunks(33).map(|tile| {
            let end = tile.iter().position(|slot| slot[3] == u32::MAX);
            end.unwrap_or(tile.len())
        });
        let mean = added.sum::<usize>() as f32 / 16.0;
        println!("left-out {bound}: {mean} panes per tile");
        assert!(mean < before, "{mean} {before}");
        before = mean;
    }
}

/// Panes as 16-bit floats are the same light, finer, in twice the memory.
#[test]
fn panes_may_be_16_bit_floats() {
    let Some(gpu) = test_gpu() else { return };
    let solved = |store| {
        let settings = [
            ("clusters", "32"),
            ("depth", "2"),
            ("left-out", "0"),
            ("store", store),
        ];
        Solver::new(&gpu, &closed_box(0.6), &settings).solve()
    };
    let [mut words, mut halves] = ["rgb9e5", "half"].map(solved);
    let bytes = [&words, &halves].map(|solver| 4 * solver.words().len());
    assert_eq!(bytes[1], 2 * bytes[0]);
    let weights = uneven_weights(0);
    let pairs = words
        .lit(&weights, 0)
        .into_iter()
        .zip(halves.lit(&weights, 0));
    let pairs = pairs.filter(|pair| pair.0[3] > 0.0);
    let off: Vec<f32> = pairs
        .map(|(lit, other)| (lit[1] / other[1] - 1.0).abs())
        .collect();
    let worst = off.iter().copied().fold(0.0, f32::max);
    println!("rgb9e5 is off by up to {worst} from 16-bit floats");
    assert!(
        off.len() > 200 && worst > 1e-5 && worst < 1.0 / 512.0,
        "{worst}"
    );
    let mut blocks = solved("bc6h");
    assert_eq!(4 * 4 * blocks.words().len(), bytes[0]);
    let pairs = blocks
        .lit(&weights, 0)
        .into_iter()
        .zip(halves.lit(&weights, 0));
    let pairs: Vec<_> = pairs.filter(|pair| pair.1[3] > 0.0).collect();
    let squares = pairs
        .iter()
        .map(|(lit, other)| (lit[1] / other[1] - 1.0).powi(2));
    let off = (squares.sum::<f32>() / pairs.len() as f32).sqrt();
    println!("bc6h is off by {off}, in the mean of squares");
    assert!(pairs.len() > 200 && off < 0.01, "{off}");
    let saved = halves.technique.save(&gpu).unwrap().unwrap();
    assert!(words.technique.resume(&gpu, &saved).is_err());
}

/// The rest shares one pane: no power is lost, and even light is exact whatever the number of panes.
#[test]
fn few_panes_keep_the_power_and_even_light() {
    let Some(gpu) = test_gpu() else { return };
    let mut solver = Solver::new(
        &gpu,
        &closed_box(0.6),
        &[("clusters", "32"), ("left-out", "0")],
    )
    .solve();
    let areas: Vec<f32> = solver.points().iter().map(|point| point.area).collect();
    let power = |lit: &[[f32; 4]]| -> f32 {
        let texels = lit.iter().zip(&areas);
        texels
            .map(|(lit, area)| if lit[3] > 0.0 { lit[1] * area } else { 0.0 })
            .sum()
    };
    let weights = uneven_weights;
    let all = solver.lit(&weights(0), 0);
    let (power_of_all, brightest) = (
        power(&all),
        all.iter().map(|lit| lit[1]).fold(0.0, f32::max),
    );
    let off = |lit: &[[f32; 4]], other: &[[f32; 4]]| {
        let pairs = lit.iter().zip(other).filter(|(lit, _)| lit[3] > 0.0);
        pairs
            .map(|(lit, other)| (lit[1] - other[1]).abs())
            .fold(0.0, f32::max)
            / brightest
    };
    let mut errors = Vec::new();
    for panes in [1, 4, 8, 16, 31, 32] {
        let few = solver.lit(&weights(0), panes);
        let kept = power(&few) / power_of_all;
        errors.push(off(&few, &all));
        println!(
            "{panes} panes: {kept} of the power, at worst {}",
            off(&few, &all)
        );
        assert!((kept - 1.0).abs() < 0.002, "{kept}");
        let even = [[0.5, 0.5, 0.5, 0.0]; 32];
        let [few, all] = [panes, 0].map(|panes| solver.lit(&even, panes));
        assert!(off(&few, &all) < 0.004, "{}", off(&few, &all));
    }
    assert!(
        errors[5] == 0.0 && errors[2] < errors[0] && errors[3] < 0.05,
        "{errors:?}"
    );
    // No step of the light is larger with few panes than it may be: nothing pops.
    let mut before = solver.lit(&weights(0), 8);
    for round in 1..120 {
        let after = solver.lit(&weights(round), 8);
        let step = off(&after, &before);
        assert!(step < 0.02, "{round}: {step}");
        before = after;
    }
}

/// The same bits, however the texels are cut and whenever the work stopped.
#[test]
fn panes_are_the_same_bits_however_they_are_made() {
    let Some(gpu) = test_gpu() else { return };
    let settings = [("entries", "256"), ("clusters", "8")];
    let scene = closed_box(0.5);
    let whole = Solver::new(&gpu, &scene, &settings).solve().words();
    let mut cut = Solver::new(&gpu, &scene, &settings);
    cut.technique.most_texels = 32 * 5;
    assert!(whole == cut.solve().words());
    let step_by_step = [&settings[..], &[("steps", "1")]].concat();
    let mut first = Solver::new(&gpu, &scene, &step_by_step);
    for stop in [1, 4, 8] {
        while first.technique.save(&gpu).unwrap().is_none()
            || first.technique.maps.get().unwrap().panes.panes_done() < stop
        {
            first.frame();
        }
        let saved = first.technique.save(&gpu).unwrap().unwrap();
        let mut rest = Solver::new(&gpu, &scene, &step_by_step);
        assert_eq!(rest.technique.resume(&gpu, &saved), Ok(false));
        loop {
            rest.frame();
            if rest.technique.resume(&gpu, &saved).unwrap() {
                break;
            }
        }
        assert!(rest.technique.maps.get().unwrap().panes.panes_done() >= stop);
        assert!(rest.solve().words() == whole, "from {stop} panes on");
        for unfit in [&saved[..saved.len() - 3], &[200][..], &[1, 7][..]] {
            assert!(first.technique.resume(&gpu, unfit).is_err());
        }
    }
}

/// Panes follow geometry and materials; until they are done again, texels keep the light they had.
#[test]
fn panes_follow_the_scene() {
    let Some(gpu) = test_gpu() else { return };
    let settings = [("entries", "256"), ("clusters", "8"), ("steps", "3")];
    let mut solver = Solver::new(&gpu, &closed_box(0.5), &settings);
    assert!(
        solver.frame().pending.is_some(),
        "there is an atlas already"
    );
    let begun = solver.frame();
    assert!(begun.progress < 1.0 && begun.pending.is_none());
    let mut solver = solver.solve();
    let before = solver.words();
    let material = Box::new(Material::matt("dark", Vec3::splat(0.2)));
    let edit = Edit::Material { index: 0, material };
    solver.scene.edit(&gpu, &[edit]).unwrap();
    let generated = solver.frame();
    assert!(generated.progress < 1.0 && generated.pending.is_none());
    let solver = solver.solve();
    assert!(solver.words() != before);
    let fresh = Solver::new(&gpu, &closed_box(0.2), &settings).solve();
    assert!(solver.words() == fresh.words());
}

/// A scene without surfaces has no light, and is done.
#[test]
fn nothing_to_light_is_done_at_once() {
    let Some(gpu) = test_gpu() else { return };
    let solver = Solver::new(&gpu, &Scene::new("empty"), &[]).solve();
    let made = solver.technique.maps.get().unwrap();
    assert!(made.panes.is_done());
    assert_eq!(made.panes.points.entries.clusters(), 0);
}
