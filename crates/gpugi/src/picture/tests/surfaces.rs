//! Surface points in colours.

use super::*;

/// Words of a surface point that faces +Z, with albedo (1, 0, 0), roughness 0 and the given instance and material.
fn point(instance: u32, material: u32) -> [u32; 12] {
    let red = 24 << 27 | 1;
    [0, 0, 0, 0, 0, 0, red, 0, 0, 0, instance, material]
}

/// Such points, whose triangles have the given provoking vertices.
fn seen(gpu: &Gpu, points: &[[u32; 12]], triangles: &[u32]) -> Receiver {
    let size = [triangles.len() as u32, 1, 1];
    let usage = wgpu::TextureUsages::TEXTURE_BINDING | wgpu::TextureUsages::COPY_DST;
    let hits = gpu.texture_2d("hits", size, wgpu::TextureFormat::R32Uint, usage);
    let hits = hits.unwrap();
    gpu.queue.write_texture(
        hits.as_image_copy(),
        bytemuck::cast_slice(triangles),
        Default::default(),
        hits.size(),
    );
    let points = SurfacePoints {
        points: gpu.storage("points", points).unwrap(),
        view: gpu.storage("view", &[0; 4]).unwrap(),
        first: 0,
        count: points.len() as u32,
        lit: points.len() as u32,
        hits: hits.create_view(&Default::default()),
        output: Default::default(),
        slots: Default::default(),
    };
    Receiver::new(&points, &Target::new(gpu, points.count).unwrap())
}

#[test]
fn surface_points_have_the_colours_of_their_quantities() {
    let gpu = gpu!();
    let near = seen(&gpu, &[point(0, 5), point(1, 5)], &[7, 7]);
    let far = seen(&gpu, &[point(u32::MAX, 0)], &[8]);
    let other = seen(&gpu, &[point(0, 5), point(1, 5)], &[7, 8]);
    let shown_of = |near: &Receiver, quantity: Quantity| -> Vec<[u8; 4]> {
        let scene = GpuScene::new(&gpu, &gpugi_scene::Scene::new("nothing")).unwrap();
        let surfaces = Surfaces::new(&gpu, [1, 3]).unwrap();
        let mut picture = Picture::new(&gpu, [1, 3]).unwrap();
        let mut frame = Frame::new(&gpu, false);
        let strips = [(near, 0..2), (&far, 2..3)];
        let strips = strips.map(|(receiver, rows)| Strip {
            receiver,
            rows,
            samples: 1,
        });
        let shown = Shown::Surfaces(&surfaces, quantity);
        picture
            .record(
                &mut frame,
                &scene,
                lit(&strips, 1),
                shown,
                &Effects::default(),
            )
            .unwrap();
        frame.submit().unwrap();
        let pixels = picture.pixels(&gpu).unwrap();
        assert_eq!(pixels[8..], [0, 0, 0, 255], "no surface is black");
        pixels.as_chunks::<4>().0.to_vec()
    };
    let shown = |quantity| shown_of(&near, quantity);
    for quantity in [Quantity::Normal, Quantity::GeometricNormal] {
        let [red, green, blue, _] = shown(quantity)[0];
        assert!((127..=128).contains(&red) && red == green && blue == 255);
    }
    assert_eq!(shown(Quantity::Albedo)[0], [255, 0, 0, 255]);
    assert_eq!(shown(Quantity::Roughness)[0], [0, 0, 0, 255]);
    let objects = shown(Quantity::Objects);
    assert_ne!(objects[0], objects[1]);
    let materials = shown(Quantity::Materials);
    assert_eq!(materials[0], materials[1]);
    let triangles = shown(Quantity::Triangles);
    assert_eq!(triangles[0], triangles[1]);
    let others = shown_of(&other, Quantity::Triangles);
    assert_eq!(others[0], triangles[0]);
    assert_ne!(others[1], triangles[1]);
}

#[test]
fn points_of_a_picture_of_another_size_are_refused() {
    let gpu = gpu!();
    let receiver = seen(&gpu, &[point(0, 0)], &[0]);
    let strips = [Strip {
        receiver: &receiver,
        rows: 0..1,
        samples: 1,
    }];
    let surfaces = Surfaces::new(&gpu, [2, 1]).unwrap();
    let mut frame = Frame::new(&gpu, false);
    let error = surfaces.record(&mut frame, &strips, Quantity::Normal);
    assert!(error.unwrap_err().to_string().contains("instead of 2"));
}
