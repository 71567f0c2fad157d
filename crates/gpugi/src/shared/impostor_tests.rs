//! Tests the searches of impostor.wesl against rays through analytic rooms, against their CPU twins, and on input with
//! no sensible answer.

use bytemuck::{Pod, Zeroable};
use glam::{DVec3, Vec3};
use wgpu::BindingResource::TextureView;

use super::impostor_cpu::{
    BOX, BOX_IN_BOX, Cube, FIRST_INNER_WALL, Hit, NOTHING, OPEN, PASSED_BEHIND, POLE_IN_BOX, Room,
    SECOND, SEEN, SPHERE, UNSEEN,
};
use crate::capture::distance_pyramid::{DistancePyramid, PyramidKernels};
use crate::gpu::{Frame, Gpu};
use crate::shader;
use crate::testing::{Random, run_kernel_on, test_gpu};

/// A search of testing/impostor.wesl.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Version {
    Robust,
    /// The tutorial's first version, with its number of iterations.
    Secant(u32),
    /// The tutorial's second version, with its number of iterations.
    FalsePosition(u32),
    /// The secant method proper, with its number of iterations.
    PureSecant(u32),
}

/// `Ray` of testing/impostor.wesl.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
struct Ray {
    origin: Vec3,
    padding_0: f32,
    direction: Vec3,
    padding_1: f32,
}

impl Ray {
    fn new(origin: Vec3, direction: Vec3) -> Self {
        Self {
            origin,
            padding_0: 0.0,
            direction,
            padding_1: 0.0,
        }
    }

    fn exact(&self) -> (DVec3, DVec3) {
        (
            self.origin.as_dvec3(),
            self.direction.as_dvec3().normalize(),
        )
    }
}

/// `Hit` of testing/impostor.wesl.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
struct Output {
    direction: Vec3,
    distance: f32,
    certainty: u32,
    steps: u32,
    padding: [u32; 2],
}

impl Output {
    fn distance(&self) -> Option<f64> {
        (self.distance >= 0.0).then_some(self.distance.into())
    }
}

fn random_rays(room: &Room, count: usize) -> Vec<Ray> {
    let mut random = Random(5);
    let mut rays = Vec::new();
    while rays.len() < count {
        let x = DVec3::from_array(std::array::from_fn(|_| 8.0 * random.next() - 4.0));
        if room.is_free(x) {
            rays.push(Ray::new(x.as_vec3(), random.direction()));
        }
    }
    rays
}

struct Impostor<'a> {
    gpu: &'a Gpu,
    distances: wgpu::TextureView,
    pyramid: wgpu::TextureView,
}

impl<'a> Impostor<'a> {
    fn new(gpu: &'a Gpu, cube: &Cube) -> Self {
        let side = cube.side as u32;
        let layers = (cube.distances.len() / (cube.side * cube.side)) as u32;
        let format = wgpu::TextureFormat::R32Float;
        let usage = wgpu::TextureUsages::TEXTURE_BINDING | wgpu::TextureUsages::COPY_DST;
        let distances = gpu.texture_2d("distances", [side, side, layers], format, usage);
        let distances = distances.unwrap();
        gpu.queue.write_texture(
            distances.as_image_copy(),
            bytemuck::cast_slice(&cube.distances),
            wgpu::TexelCopyBufferLayout {
                offset: 0,
                bytes_per_row: Some(4 * side),
                rows_per_image: Some(side),
            },
            distances.size(),
        );
        let pyramid =
            DistancePyramid::new(gpu, &PyramidKernels::new(gpu).unwrap(), &distances).unwrap();
        let mut frame = Frame::new(gpu, false);
        pyramid.record(&mut frame);
        frame.submit().unwrap();
        let layers = |texture: &wgpu::Texture| {
            texture.create_view(&wgpu::TextureViewDescriptor {
                dimension: Some(wgpu::TextureViewDimension::D2Array),
                ..Default::default()
            })
        };
        Self {
            gpu,
            distances: layers(&distances),
            pyramid: layers(&pyramid.texture),
        }
    }

    fn search(&self, version: Version, rays: &[Ray]) -> Vec<Output> {
        let gpu = self.gpu;
        let settings = match version {
            Version::Robust => [0, 0],
            Version::Secant(iterations) => [1, iterations],
            Version::FalsePosition(iterations) => [2, iterations],
            Version::PureSecant(iterations) => [3, iterations],
        };
        let settings = gpu.uniform("search", &settings).unwrap();
        let input = gpu.storage("rays", rays).unwrap();
        run_kernel_on(
            gpu,
            &shader!("testing.impostor"),
            "main",
            &[
                ("search", settings.as_entire_binding()),
                ("rays", input.as_entire_binding()),
                ("distances_unfilterable", TextureView(&self.distances)),
                ("pyramid_unfilterable", TextureView(&self.pyramid)),
            ],
            rays.len(),
            rays.len() as u32,
        )
        .unwrap()
    }
}

fn twin(cube: &Cube, version: Version, ray: &Ray) -> Hit {
    let (x, r) = ray.exact();
    match version {
        Version::Robust => cube.search(x, r),
        Version::Secant(iterations) => cube.tutorial(true, x, r, iterations),
        Version::FalsePosition(iterations) => cube.tutorial(false, x, r, iterations),
        Version::PureSecant(iterations) => cube.pure_secant(x, r, iterations),
    }
}

/// Quality of a search. Errors are over rays whose hit the reference point sees, in widths of the texel at the hit;
/// shares are fractions of the hits named.
#[derive(Debug, Default)]
struct Score {
    mean: f64,
    worst: f64,
    /// Share of lookups that show a different wall: for seen hits, and for unseen hits.
    wrong_wall: [f64; 2],
    /// Share of seen hits reported as unseen.
    called_unseen: f64,
    /// Share of unseen hits reported as seen.
    called_seen: f64,
    mean_steps: f64,
    most_steps: u32,
}

fn score(room: &Room, cube: &Cube, rays: &[Ray], outputs: &[Output]) -> Score {
    let mut score = Score::default();
    let (mut counts, mut unknown) = ([0.0_f64; 2], 0.0);
    for (ray, output) in rays.iter().zip(outputs) {
        score.mean_steps += f64::from(output.steps) / rays.len() as f64;
        score.most_steps = score.most_steps.max(output.steps);
        let (x, r) = ray.exact();
        let Some((exact, wall)) = room.cast(x, r) else {
            continue;
        };
        let q = x + r * exact;
        let kind = usize::from(!room.is_seen(q));
        counts[kind] += 1.0;
        let toward = output.direction.as_dvec3();
        let looked_up = if output.certainty == SECOND {
            room.cast_second(toward)
        } else {
            room.cast(DVec3::ZERO, toward)
        };
        if looked_up.is_none_or(|hit| hit.1 != wall) {
            score.wrong_wall[kind] += 1.0;
        }
        if kind == 1 {
            score.called_seen += f64::from(u8::from(output.certainty == SEEN));
        } else {
            score.called_unseen += f64::from(u8::from(output.certainty == UNSEEN));
            // The search lost the hit, which may be anywhere.
            if output.distance > 1e17 {
                unknown += 1.0;
                continue;
            }
            let off = output.distance().map_or(f64::MAX, |d| (d - exact).abs());
            let error = off / (cube.texel() * q.length());
            score.mean += error;
            score.worst = score.worst.max(error);
        }
    }
    let [seen, unseen] = counts.map(|count| count.max(1.0));
    score.mean /= seen - unknown;
    score.wrong_wall = [score.wrong_wall[0] / seen, score.wrong_wall[1] / unseen];
    score.called_unseen /= seen;
    score.called_seen /= unseen;
    score
}

#[test]
fn searches_are_what_their_twins_are() {
    let Some(gpu) = test_gpu() else { return };
    let one = [SPHERE, BOX, BOX_IN_BOX, POLE_IN_BOX, OPEN].map(|room| (room, Cube::new(32, &room)));
    let two = [BOX_IN_BOX, POLE_IN_BOX, OPEN].map(|room| (room, Cube::with_second(32, &room)));
    for (room, cube) in one.into_iter().chain(two) {
        let impostor = Impostor::new(&gpu, &cube);
        let rays = random_rays(&room, 2000);
        for version in [
            Version::Robust,
            Version::Secant(0),
            Version::Secant(3),
            Version::FalsePosition(0),
            Version::FalsePosition(4),
            Version::PureSecant(0),
            Version::PureSecant(1),
            Version::PureSecant(2),
        ] {
            let outputs = impostor.search(version, &rays);
            let differ = rays.iter().zip(&outputs).filter(|(ray, output)| {
                let found = twin(&cube, version, ray);
                let is_same = match (found.distance, output.distance()) {
                    (None, None) => true,
                    (Some(a), Some(b)) => (a - b).abs() < 2e-3 * (a + 0.1),
                    _ => false,
                };
                let direction = output.direction.as_dvec3();
                !is_same
                    || found.certainty != output.certainty
                    || direction.distance(found.direction) > 1e-2
            });
            // Rays along a cell border may fall on either side of it.
            let (differ, first) = (differ.clone().count(), differ.clone().next());
            assert!(
                differ < 20,
                "{room:?}, {version:?}: {differ} of 2000 differ, {first:?} from {:?}",
                first.map(|(ray, _)| twin(&cube, version, ray))
            );
        }
    }
}

#[test]
fn the_robust_search_is_exact_in_empty_rooms() {
    let Some(gpu) = test_gpu() else { return };
    for (room, mean, worst) in [(SPHERE, 0.01, 0.1), (BOX, 0.015, 1.5)] {
        for side in [16, 64, 128] {
            let cube = Cube::new(side, &room);
            let rays = random_rays(&room, 4000);
            let outputs = Impostor::new(&gpu, &cube).search(Version::Robust, &rays);
            let score = score(&room, &cube, &rays, &outputs);
            // Coarse texels resolve curvature and corners less well.
            let coarse = (64.0 / side as f64).max(1.0);
            assert!(
                score.mean < mean * coarse && score.worst < worst * coarse,
                "{side}: {score:?}"
            );
            assert!(
                outputs.iter().all(|output| output.certainty == SEEN),
                "{side}: {score:?}"
            );
            assert!(score.mean_steps < 20.0, "{side}: {score:?}");
        }
    }
}

#[test]
fn hits_that_the_reference_point_cannot_see_are_known() {
    let Some(gpu) = test_gpu() else { return };
    let cube = Cube::new(128, &BOX_IN_BOX);
    let rays = random_rays(&BOX_IN_BOX, 8000);
    let impostor = Impostor::new(&gpu, &cube);
    let outputs = impostor.search(Version::Robust, &rays);
    let robust = score(&BOX_IN_BOX, &cube, &rays, &outputs);
    assert!(robust.called_seen < 0.06, "{robust:?}");
    assert!(robust.called_unseen < 0.003, "{robust:?}");
    assert!(
        robust.mean < 0.2 && robust.wrong_wall[0] < 0.01,
        "{robust:?}"
    );
    assert!(robust.mean_steps < 24.0, "{robust:?}");
    let passed = outputs
        .iter()
        .filter(|output| output.certainty == PASSED_BEHIND);
    assert!(passed.count() > 100, "rays pass behind the box");
    let outputs = impostor.search(Version::FalsePosition(8), &rays);
    let plain = score(&BOX_IN_BOX, &cube, &rays, &outputs);
    assert!(
        robust.wrong_wall[1] < plain.wrong_wall[1] && robust.wrong_wall[0] < plain.wrong_wall[0],
        "{robust:?}, {plain:?}"
    );
}

#[test]
fn a_second_layer_shows_what_is_hidden() {
    let Some(gpu) = test_gpu() else { return };
    for room in [BOX_IN_BOX, POLE_IN_BOX] {
        let rays = random_rays(&room, 8000);
        let of = |cube: Cube| {
            let outputs = Impostor::new(&gpu, &cube).search(Version::Robust, &rays);
            (score(&room, &cube, &rays, &outputs), outputs)
        };
        let (one, _) = of(Cube::new(128, &room));
        let (two, outputs) = of(Cube::with_second(128, &room));
        // The remaining errors are backs of the inner box.
        assert!(
            one.wrong_wall[1] > 0.45 && two.wrong_wall[1] < 0.25,
            "{room:?}: {one:?}, {two:?}"
        );
        assert!(
            two.wrong_wall[0] <= one.wrong_wall[0] && two.mean <= 1.01 * one.mean,
            "{room:?}: {one:?}, {two:?}"
        );
        let (mut found, mut off) = (0, 0);
        for (ray, output) in rays.iter().zip(&outputs) {
            if output.certainty == SECOND {
                let (x, r) = ray.exact();
                let (exact, _) = room.cast(x, r).unwrap();
                let is_off = (f64::from(output.distance) - exact).abs() > 0.02 * exact;
                found += 1;
                off += i32::from(is_off);
            }
        }
        assert!(
            found > 100 && 10 * off < found,
            "{room:?}: {off} of {found} hits in the second layer are elsewhere"
        );
    }
}

/// Section 5.1.2: the secant method usually converges faster than false position, where the surface is simple.
#[test]
fn the_secant_method_converges_faster_in_an_empty_room() {
    let Some(gpu) = test_gpu() else { return };
    let cube = Cube::new(128, &SPHERE);
    let rays = random_rays(&SPHERE, 4000);
    let impostor = Impostor::new(&gpu, &cube);
    let mean = |version| {
        let outputs = impostor.search(version, &rays);
        score(&SPHERE, &cube, &rays, &outputs).mean
    };
    for iterations in [2, 4] {
        let pure = mean(Version::PureSecant(iterations));
        let both = mean(Version::Secant(iterations));
        assert!(pure < 0.5 * both, "{iterations}: {pure}, {both}");
    }
    // Without an iteration, both return the first guess.
    let [pure, both] = [Version::PureSecant(0), Version::Secant(0)].map(mean);
    assert!((pure - both).abs() < 1e-6 * both, "{pure}, {both}");
}

#[test]
fn thin_things_are_found() {
    let Some(gpu) = test_gpu() else { return };
    let cube = Cube::new(64, &POLE_IN_BOX);
    let rays: Vec<_> = random_rays(&POLE_IN_BOX, 100_000)
        .into_iter()
        .filter(|ray| {
            let (x, r) = ray.exact();
            POLE_IN_BOX
                .cast(x, r)
                .is_some_and(|(d, wall)| wall >= FIRST_INNER_WALL && POLE_IN_BOX.is_seen(x + r * d))
        })
        .collect();
    assert!(rays.len() > 300, "{} rays meet the pole", rays.len());
    let impostor = Impostor::new(&gpu, &cube);
    let found = |version| {
        let outputs = impostor.search(version, &rays);
        let near = rays.iter().zip(&outputs).filter(|(ray, output)| {
            let (x, r) = ray.exact();
            let (exact, _) = POLE_IN_BOX.cast(x, r).unwrap();
            output.distance().is_some_and(|d| (d - exact).abs() < 0.1)
        });
        near.count() as f64 / rays.len() as f64
    };
    let (robust, plain) = (found(Version::Robust), found(Version::FalsePosition(8)));
    assert!(
        robust > 0.85 && plain < 0.6,
        "{robust}, {plain} of the rays"
    );
}

#[test]
fn rays_within_a_refractor_reach_its_other_side() {
    let Some(gpu) = test_gpu() else { return };
    let Room::Sphere(center, radius) = SPHERE else {
        unreachable!()
    };
    let cube = Cube::new(128, &SPHERE);
    let mut random = Random(9);
    let rays: Vec<_> = (0..4000)
        .map(|_| {
            let normal = random.direction();
            let mut r = random.direction();
            // Refracted and totally reflected rays enter more steeply than this.
            if r.dot(normal) > -0.1 {
                r = (r - normal * (r.dot(normal) + 0.1 + random.next() as f32)).normalize();
            }
            Ray::new(center.as_vec3() + normal * radius as f32, r)
        })
        .collect();
    let outputs = Impostor::new(&gpu, &cube).search(Version::Robust, &rays);
    for (ray, output) in rays.iter().zip(&outputs) {
        let (x, r) = ray.exact();
        let chord = -2.0 * (x - center).dot(r);
        let error = (f64::from(output.distance) - chord).abs() / (cube.texel() * radius);
        assert!(
            error < 0.5 && output.certainty == SEEN,
            "{ray:?}: {output:?}, chord {chord}"
        );
    }
}

#[test]
fn hopeless_rays_end_well() {
    let Some(gpu) = test_gpu() else { return };
    let versions = [
        Version::Robust,
        Version::Secant(4),
        Version::FalsePosition(4),
        Version::PureSecant(4),
    ];
    let axes = [
        Vec3::X,
        Vec3::NEG_Y,
        Vec3::Z,
        Vec3::ONE.normalize(),
        Vec3::new(0.6, 0.8, 0.0),
    ];
    let mut rays = Vec::new();
    for r in axes {
        // Origins at the reference point, with rays through it, away from it, along the cube's edges, behind the walls,
        // and far away.
        for x in [
            Vec3::ZERO,
            -1.1 * r,
            r,
            Vec3::ONE,
            Vec3::X * 9.0,
            Vec3::splat(-50.0),
            r * 1e-20,
        ] {
            rays.push(Ray::new(x, r));
            rays.push(Ray::new(x + Vec3::splat(1e-7), -r));
        }
    }
    let filled = |distance| Cube {
        side: 16,
        distances: vec![distance; 6 * 16 * 16],
    };
    let mut broken = Cube::new(16, &OPEN);
    for (i, distance) in broken.distances.iter_mut().enumerate() {
        *distance = [*distance, 0.0, f32::MIN_POSITIVE, NOTHING][i % 4];
    }
    for cube in [
        Cube::new(16, &BOX),
        Cube::new(16, &OPEN),
        filled(NOTHING),
        filled(0.0),
        broken,
    ] {
        let impostor = Impostor::new(&gpu, &cube);
        for version in versions {
            for (ray, output) in rays.iter().zip(impostor.search(version, &rays)) {
                assert!(
                    (output.direction.length() - 1.0).abs() < 1e-3 && output.distance.is_finite(),
                    "{version:?} of {ray:?}: {output:?}"
                );
                assert!(output.steps <= 1024, "{version:?} of {ray:?}: {output:?}");
            }
        }
    }
    // From the reference point, and from close to it, everything is where the cube says.
    let impostor = Impostor::new(&gpu, &Cube::new(16, &BOX));
    for version in versions {
        for x in [Vec3::ZERO, Vec3::splat(1e-6)] {
            let rays = axes.map(|r| Ray::new(x, r));
            for (ray, output) in rays.iter().zip(impostor.search(version, &rays)) {
                let (exact, _) = BOX.cast(DVec3::ZERO, ray.exact().1).unwrap();
                assert!(
                    (f64::from(output.distance) - exact).abs() < 0.02 * exact,
                    "{version:?} of {ray:?}: {output:?}, not {exact}"
                );
            }
        }
    }
    // With nothing around, every ray leaves.
    let impostor = Impostor::new(&gpu, &filled(NOTHING));
    for version in versions {
        let outputs = impostor.search(version, &rays);
        assert!(
            outputs.iter().all(|output| output.distance().is_none()),
            "{version:?}"
        );
    }
    // Rays start behind a wall. One that emerges has not been visible all along; one that does not is unseen.
    let impostor = Impostor::new(&gpu, &Cube::new(16, &BOX));
    let outputs = impostor.search(
        Version::Robust,
        &[
            Ray::new(Vec3::X * 9.0, Vec3::NEG_X),
            Ray::new(Vec3::X * 9.0, Vec3::X),
        ],
    );
    assert_eq!(outputs[0].certainty, PASSED_BEHIND, "{outputs:?}");
    assert!((outputs[0].distance - 11.1).abs() < 0.01, "{outputs:?}");
    assert_eq!(outputs[1].certainty, UNSEEN, "{outputs:?}");
}

#[test]
fn cubes_of_odd_sizes_are_refused() {
    let Some(gpu) = test_gpu() else { return };
    for (width, height) in [(4, 4), (24, 24), (16, 32)] {
        let format = wgpu::TextureFormat::R32Float;
        let usage = wgpu::TextureUsages::TEXTURE_BINDING;
        let distances = gpu.texture_2d("distances", [width, height, 6], format, usage);
        let distances = distances.unwrap();
        let error = DistancePyramid::new(&gpu, &PyramidKernels::new(&gpu).unwrap(), &distances)
            .unwrap_err();
        assert!(error.to_string().contains("power of two"), "{error}");
    }
}

/// Prints the table of docs/techniques/distance-impostor.md.
#[test]
#[ignore = "prints a table"]
fn print_errors() {
    let Some(gpu) = test_gpu() else { return };
    println!(
        "| room | texels | search | mean | worst | wrong wall | unseen called seen | seen called unseen | unseen: wrong wall | steps, most |"
    );
    println!("|---|---|---|---|---|---|---|---|---|---|");
    let print = |name: &str, version: Version, s: &Score, side: usize| {
        let percent = [
            s.wrong_wall[0],
            s.called_seen,
            s.called_unseen,
            s.wrong_wall[1],
        ]
        .map(|share| format!("{:.2} %", 100.0 * share))
        .join(" | ");
        println!(
            "| {name} | {side} | {version:?} | {:.3} | {:.1} | {percent} | {:.1}, {} |",
            s.mean, s.worst, s.mean_steps, s.most_steps,
        );
    };
    for (name, room) in [
        ("sphere", SPHERE),
        ("box", BOX),
        ("box in a box", BOX_IN_BOX),
        ("pole in a box", POLE_IN_BOX),
    ] {
        for side in [64, 256, 1024] {
            let rays = random_rays(&room, 20_000);
            if matches!(room, Room::Box(_, Some(_))) {
                let cube = Cube::with_second(side, &room);
                let outputs = Impostor::new(&gpu, &cube).search(Version::Robust, &rays);
                print(
                    &format!("{name}, two layers"),
                    Version::Robust,
                    &score(&room, &cube, &rays, &outputs),
                    side,
                );
            }
            let cube = Cube::new(side, &room);
            let impostor = Impostor::new(&gpu, &cube);
            let mut versions = vec![Version::Robust];
            for iterations in [0, 1, 2, 4, 8].into_iter().filter(|_| side == 256) {
                versions.push(Version::Secant(iterations));
                versions.push(Version::FalsePosition(iterations));
                versions.push(Version::PureSecant(iterations));
            }
            for version in versions {
                let outputs = impostor.search(version, &rays);
                print(name, version, &score(&room, &cube, &rays, &outputs), side);
            }
        }
    }
}
