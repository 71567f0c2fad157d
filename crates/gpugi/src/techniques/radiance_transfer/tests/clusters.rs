//! Vectors compressed by clustered principal component analysis.

use super::*;

/// Settings of compressed vectors.
const COMPRESSED: [(&str, &str); 2] = [("compressed", "true"), ("resolution", "64")];

fn solved(gpu: &Gpu, scene: &Scene, settings: &[(&str, &str)]) -> Solver {
    Solver::new(gpu, scene, &[&COMPRESSED[..], settings].concat()).solve()
}

/// Root mean square of the difference from `truth`, relative to that of `truth`.
fn error(found: &[(Point, Vec3)], truth: &[(Point, Vec3)]) -> f32 {
    let pairs = found.iter().zip(truth);
    let off: f32 = pairs.map(|(a, b)| (a.1 - b.1).length_squared()).sum();
    let all: f32 = truth.iter().map(|texel| texel.1.length_squared()).sum();
    (off / all).sqrt()
}

fn saved(solver: &Solver) -> Saved {
    let bytes = solver.transfer.save(&solver.gpu).unwrap().unwrap();
    postcard::from_bytes(&bytes).unwrap()
}

/// Below 1 % of the light, at least seven times smaller, under any light.
#[test]
fn compressed_vectors_light_as_they_did() {
    let Some(gpu) = test_gpu() else { return };
    let mut scene = corner();
    let plain = [("compressed", "false"), ("bounces", "2")];
    let mut whole = solved(&gpu, &scene, &plain);
    let mut small = solved(&gpu, &scene, &[("bounces", "2")]);
    let mut one = solved(&gpu, &scene, &[("bounces", "2"), ("components", "1")]);
    for rotation in [0.0, 2.0] {
        let environment = scene.environment.as_mut().unwrap();
        environment.rotation = glam::Quat::from_rotation_y(rotation);
        let edit = Edit::Environment(environment.clone());
        for solver in [&mut whole, &mut small, &mut one] {
            solver
                .scene
                .edit(&gpu, std::slice::from_ref(&edit))
                .unwrap();
            assert!(solver.frame().progress >= 1.0);
        }
        let truth = whole.texels();
        let [of_twelve, of_one] = [&small, &one].map(|solver| error(&solver.texels(), &truth));
        println!("{of_twelve}; with one component {of_one}");
        assert!(of_twelve < 0.01, "{of_twelve}");
        assert!(of_one > 2.0 * of_twelve, "{of_one}");
    }
    let settings = &small.transfer.settings;
    assert!(7 * 4 * settings.words_of_weights() <= 6 * settings.terms());
    let bytes = |solver: &Solver| solver.transfer.inspect().work_bytes;
    let freed = bytes(&whole) - bytes(&small);
    println!("{} and {} bytes", bytes(&whole), bytes(&small));
    assert!(freed > 64 * 64 * 200, "{freed}");
}

/// Each texel that has a point belongs to a cluster, and no cluster is smaller than the minimum.
#[test]
fn clusters_have_the_least_number_of_texels() {
    let Some(gpu) = test_gpu() else { return };
    let [order, rays] = [("order", "3"), ("rays", "64")];
    for (minimum, clusters) in [("200", "64"), ("1", "16"), ("65536", "64")] {
        let settings = [("minimum", minimum), ("clusters", clusters), order, rays];
        let solver = solved(&gpu, &corner(), &settings);
        let saved = saved(&solver).compressed.unwrap();
        let words = solver.transfer.settings.words_of_weights() as usize;
        let mut sizes = std::collections::BTreeMap::<u16, usize>::new();
        for texel in saved.weights.chunks(words) {
            *sizes.entry(texel[0] as u16).or_default() += 1;
        }
        sizes.remove(&u16::MAX);
        let points = solver.texels().len();
        println!("{points} points in {sizes:?}");
        assert_eq!(sizes.values().sum::<usize>(), points);
        let least = minimum.parse::<usize>().unwrap().min(points);
        assert!(sizes.values().all(|&size| size >= least), "{sizes:?}");
        let most = (points / least).min(clusters.parse().unwrap());
        assert!(sizes.len() <= most && 2 * sizes.len() >= most, "{sizes:?}");
    }
}

/// Compressed vectors are saved instead of the whole ones, and continue to the same bits; what does not fit is refused.
#[test]
fn compressed_vectors_are_saved() {
    let Some(gpu) = test_gpu() else { return };
    // Sizes that no buffer has without padding.
    let settings = [
        ("order", "3"),
        ("minimum", "100"),
        ("rays", "64"),
        ("resolution", "33"),
        ("components", "11"),
    ];
    let scene = corner();
    let solver = solved(&gpu, &scene, &settings);
    let found = solver.texels();
    let bytes = solver.transfer.save(&gpu).unwrap().unwrap();
    assert!(saved(&solver).transfer.vectors.is_empty());
    let all = [&COMPRESSED[..], &settings].concat();
    let begun = |settings: &[(&str, &str)]| Solver::new(&gpu, &scene, settings).with_atlas();
    let mut rest = begun(&all);
    assert_eq!(rest.transfer.resume(&gpu, &bytes), Ok(true));
    assert!(rest.frame().progress >= 1.0);
    let same = |texels: &[(Point, Vec3)], other: &[(Point, Vec3)]| {
        texels.iter().map(|a| a.1).eq(other.iter().map(|b| b.1))
    };
    assert!(same(&rest.texels(), &found));
    // Progress from before the compression gives the same clusters.
    let mut whole = begun(&[&all[..], &[("compressed", "false")]].concat()).solve();
    let vectors = whole.transfer.save(&gpu).unwrap().unwrap();
    let mut rest = begun(&all);
    assert_eq!(rest.transfer.resume(&gpu, &vectors), Ok(true));
    assert!(same(&rest.solve().texels(), &found));

    assert!(whole.transfer.resume(&gpu, &bytes).is_err());
    let mut other = begun(&[&all[..], &[("components", "14")]].concat());
    assert!(other.transfer.resume(&gpu, &bytes).is_err());
    let mut rest = begun(&all);
    let mut changed = |change: &dyn Fn(&mut Saved)| {
        let mut saved = saved(&solver);
        change(&mut saved);
        let bytes = postcard::to_allocvec(&saved).unwrap();
        rest.transfer.resume(&gpu, &bytes).is_err()
    };
    assert!(changed(&|saved| saved.compressed = None));
    assert!(changed(&|saved| saved.transfer.bounces = 0));
    assert!(changed(&|saved| {
        saved.compressed.as_mut().unwrap().weights.truncate(7);
    }));
    assert!(changed(&|saved| {
        saved.compressed.as_mut().unwrap().weights.fill(0xfffe);
    }));
    assert!(changed(&|saved| {
        let weights = &mut saved.compressed.as_mut().unwrap().weights;
        weights.iter_mut().for_each(|word| *word |= 0x7c00_0000);
    }));
    assert!(changed(&|saved| {
        saved.compressed.as_mut().unwrap().subspaces[0] = 0x7c00;
    }));
}

/// Other materials need other vectors, which are compressed, too.
#[test]
fn changed_scenes_are_compressed_anew() {
    let Some(gpu) = test_gpu() else { return };
    let settings = [("order", "3"), ("bounces", "2"), ("rays", "64")];
    let scene = |albedo: f32| {
        let mut scene = corner();
        scene.materials[0] = Material::matt("floor", Vec3::splat(albedo));
        scene
    };
    let mut solver = solved(&gpu, &scene(0.8), &settings);
    let before = solver.texels();
    let material = Box::new(scene(0.2).materials[0].clone());
    solver
        .scene
        .edit(&gpu, &[Edit::Material { index: 0, material }])
        .unwrap();
    let after = solver.solve().texels();
    let fresh = solved(&gpu, &scene(0.2), &settings).texels();
    assert!(after.iter().map(|a| a.1).eq(fresh.iter().map(|b| b.1)));
    assert!(error(&after, &before) > 0.01);
}
