//! Every linked shader keeps within WebGPU's default limits; and the plumbing works: bindings, limits, error scopes,
//! read-back, timings.

use super::kernel::Interface;
use super::{
    BindingKind, Frame, Gpu, GpuError, HostBuffer, Kernel, Shader, all_shaders, read_buffer,
    read_texture,
};
use crate::shader;
use crate::testing::{own_test_gpu, run_kernel, test_gpu};

fn shaders() -> Vec<Shader> {
    all_shaders()
        .iter()
        .map(|&(name, source)| Shader {
            name,
            source: source.into(),
        })
        .collect()
}

#[test]
fn every_shader_parses_and_validates() {
    let shaders = shaders();
    assert!(
        shaders.len() > 8,
        "build.rs found {} shaders",
        shaders.len()
    );
    for shader in shaders {
        shader.validate().unwrap_or_else(|error| panic!("{error}"));
    }
}

/// Group 0 of a pipeline that reads the scene is the whole scene, however little of it the shader uses.
fn layout_of(shader: &Shader) -> (naga::Module, Vec<super::shader::Declared>) {
    let module = shader.parse().unwrap();
    let mut declared = shader.declared(&module).unwrap();
    if reads_scene(shader) {
        let has_rays = traces_rays(&declared);
        declared.retain(|variable| variable.group != 0);
        for scene in &scene_shaders()[..1 + usize::from(has_rays)] {
            declared.extend(scene.declared(&scene.parse().unwrap()).unwrap());
        }
    }
    (module, declared)
}

/// The modules that declare group 0; the second only for pipelines that trace rays.
fn scene_shaders() -> [Shader; 2] {
    [shader!("scene.bindings"), shader!("scene.ray_bindings")]
}

fn traces_rays(declared: &[super::shader::Declared]) -> bool {
    declared
        .iter()
        .any(|variable| variable.name.contains("ray_bindings"))
}

/// Whether group 0 holds the scene: kernels of `testing` use that group for their own buffers.
fn reads_scene(shader: &Shader) -> bool {
    let module = shader.parse().unwrap();
    let declared = shader.declared(&module).unwrap();
    declared.iter().any(|variable| variable.group == 0)
        && declared.iter().all(|variable| {
            variable.group != 0
                || variable.name.contains("bindings")
                || shader.name.ends_with("bindings")
        })
}

#[test]
fn every_shader_stays_within_the_default_limits() {
    let limits = wgpu::Limits::default();
    for shader in shaders() {
        let (module, declared) = layout_of(&shader);
        let count = |test: fn(BindingKind) -> bool| {
            declared
                .iter()
                .filter(|variable| test(variable.kind))
                .count() as u32
        };
        let is_storage = |kind| matches!(kind, BindingKind::Storage | BindingKind::ReadOnlyStorage);
        let is_sampler =
            |kind| matches!(kind, BindingKind::Sampler | BindingKind::ComparisonSampler);
        let is_compute = module
            .entry_points
            .iter()
            .any(|point| point.stage == naga::ShaderStage::Compute);
        // Mesa 22.3, which many machines still have, crashes on a compute shader with a fourth uniform buffer.
        let uniforms = if is_compute {
            3
        } else {
            limits.max_uniform_buffers_per_shader_stage
        };
        let groups = declared
            .iter()
            .map(|variable| variable.group + 1)
            .max()
            .unwrap_or(0);
        for (what, has, may) in [
            (
                "storage buffers",
                count(is_storage),
                limits.max_storage_buffers_per_shader_stage.min(8),
            ),
            (
                "uniform buffers",
                count(|kind| kind == BindingKind::Uniform),
                uniforms,
            ),
            (
                "sampled textures",
                count(|kind| matches!(kind, BindingKind::Texture(..))),
                limits.max_sampled_textures_per_shader_stage.min(16),
            ),
            (
                "storage textures",
                count(|kind| matches!(kind, BindingKind::StorageTexture(..))),
                limits.max_storage_textures_per_shader_stage.min(4),
            ),
            (
                "samplers",
                count(is_sampler),
                limits.max_samplers_per_shader_stage.min(16),
            ),
            ("bind groups", groups, limits.max_bind_groups.min(4)),
        ] {
            assert!(
                has <= may,
                "{}: {has} {what}, {may} are allowed",
                shader.name
            );
        }
        for point in &module.entry_points {
            let invocations: u32 = point.workgroup_size.iter().product();
            assert!(
                invocations <= 256,
                "{}: workgroups of {invocations}",
                shader.name
            );
        }
    }
}

/// Gathers leave room for maps of other techniques that they look up.
#[test]
fn every_gather_leaves_two_storage_buffers_free() {
    let gathers: Vec<Shader> = shaders()
        .into_iter()
        .filter(|shader| shader.name.ends_with(".gather"))
        .collect();
    assert!(gathers.len() >= 7);
    for shader in gathers {
        let (_, declared) = layout_of(&shader);
        let is_storage = |variable: &&super::shader::Declared| {
            matches!(
                variable.kind,
                BindingKind::Storage | BindingKind::ReadOnlyStorage
            )
        };
        let storage = declared.iter().filter(is_storage).count();
        assert!(storage <= 6, "{}: {storage} storage buffers", shader.name);
    }
}

#[test]
fn every_entry_point_becomes_a_pipeline() {
    let Some(gpu) = own_gpu() else { return };
    let scene_shaders = scene_shaders();
    let scene = super::scene_layout(&gpu, &scene_shaders[..1]).unwrap();
    let with_rays = super::scene_layout(&gpu, &scene_shaders).unwrap();
    for shader in shaders() {
        let module = shader.parse().unwrap();
        let traces_rays = traces_rays(&shader.declared(&module).unwrap());
        let scene = if traces_rays { &with_rays } else { &scene };
        let scene = reads_scene(&shader).then_some(scene);
        let is_compute = |point: &naga::EntryPoint| point.stage == naga::ShaderStage::Compute;
        let (compute, raster): (Vec<_>, Vec<_>) = module
            .entry_points
            .iter()
            .partition(|point| is_compute(point));
        // Test the module and the layout; its pass sets the state of a raster pipeline.
        if !raster.is_empty() {
            let stages = wgpu::ShaderStages::VERTEX_FRAGMENT;
            Interface::new(&gpu, &shader, stages, scene).unwrap_or_else(|error| panic!("{error}"));
            super::kernel::shader_module(&gpu, &shader, false);
        }
        for point in compute {
            Kernel::new(&gpu, &shader, &point.name, scene)
                .unwrap_or_else(|error| panic!("{error}"));
        }
    }
    while gpu.is_compiling() {
        std::thread::yield_now();
    }
    gpu.check().unwrap();
}

fn copy_kernel(gpu: &Gpu) -> Kernel {
    Kernel::new(gpu, &shader!("testing.copy"), "main", None).unwrap()
}

#[test]
fn a_kernel_that_is_made_again_compiles_nothing() {
    let Some(gpu) = test_gpu() else { return };
    // Its pipelines wait until they are asked for.
    let gpu = gpu.as_in_a_browser();
    let waiting = || gpu.compiling.load(std::sync::atomic::Ordering::Relaxed);
    let first = copy_kernel(&gpu);
    assert_eq!(waiting(), 1);
    while gpu.is_compiling() {}
    drop(first);
    let _again = copy_kernel(&gpu);
    assert_eq!(waiting(), 0);
    let unchecked = super::KernelOptions {
        unchecked: true,
        ..Default::default()
    };
    let other = Kernel::with_options(&gpu, &shader!("testing.copy"), "main", None, &unchecked);
    let _other = other.unwrap();
    assert_eq!(waiting(), 1);
    while gpu.is_compiling() {}
}

#[test]
fn a_wrong_binding_is_an_error_that_names_shader_and_binding() {
    let Some(gpu) = test_gpu() else { return };
    let kernel = copy_kernel(&gpu);
    let buffer = gpu.storage("words", &[1_u32; 4]).unwrap();
    let (whole, other) = (buffer.as_entire_binding(), buffer.as_entire_binding());
    let error = kernel
        .bind(
            &gpu,
            0,
            &[("origin", whole.clone()), ("output", other.clone())],
        )
        .unwrap_err()
        .to_string();
    assert!(
        error.contains("testing.copy") && error.contains("\"source\""),
        "{error}"
    );
    let error = kernel
        .bind(&gpu, 2, &[("source", whole.clone())])
        .unwrap_err()
        .to_string();
    assert!(
        error.contains("testing.copy") && error.contains("group 2"),
        "{error}"
    );
    let three = [
        ("source", whole.clone()),
        ("output", other),
        ("more", whole),
    ];
    let error = kernel.bind(&gpu, 0, &three).unwrap_err().to_string();
    assert!(
        error.contains("testing.copy") && error.contains("3 resources"),
        "{error}"
    );
}

#[test]
fn a_missing_entry_point_is_an_error_that_names_it() {
    let Some(gpu) = test_gpu() else { return };
    let error = Kernel::new(&gpu, &shader!("testing.copy"), "paste", None)
        .unwrap_err()
        .to_string();
    assert!(error.contains("testing.copy.paste"), "{error}");
}

#[test]
fn a_shader_that_does_not_parse_is_an_error_with_the_place() {
    let Some(gpu) = test_gpu() else { return };
    let broken = Shader {
        name: "testing.broken",
        source: "@compute @workgroup_size(1) fn main() { let a = ; }".into(),
    };
    let error = Kernel::new(&gpu, &broken, "main", None)
        .unwrap_err()
        .to_string();
    assert!(
        error.contains("testing.broken") && error.contains(":1:"),
        "{error}"
    );
}

#[test]
fn what_exceeds_a_limit_is_too_large_with_the_numbers() {
    let Some(gpu) = test_gpu() else { return };
    let limits = gpu.limits();
    let storage = limits
        .max_buffer_size
        .min(limits.max_storage_buffer_binding_size);
    let error = gpu
        .buffer("huge", storage + 16, wgpu::BufferUsages::STORAGE)
        .unwrap_err();
    let GpuError::TooLarge {
        what,
        needed,
        limit,
        ..
    } = &error
    else {
        panic!("{error}");
    };
    assert_eq!((what.as_str(), *limit), ("huge", storage));
    assert!(*needed > storage);
    let text = error.to_string();
    assert!(
        text.contains(&needed.to_string()) && text.contains(&limit.to_string()),
        "{text}"
    );
    let side = limits.max_texture_dimension_2d;
    for (size, limit) in [
        ([side + 1, 1, 1], side),
        (
            [1, 1, limits.max_texture_array_layers + 1],
            limits.max_texture_array_layers,
        ),
    ] {
        let [width, height, depth_or_array_layers] = size;
        let extent = wgpu::Extent3d {
            width,
            height,
            depth_or_array_layers,
        };
        match gpu.texture(&texture("wide", extent, wgpu::TextureFormat::R8Unorm)) {
            Err(GpuError::TooLarge {
                needed,
                limit: allowed,
                ..
            }) => {
                assert_eq!((needed, allowed), (u64::from(limit) + 1, u64::from(limit)));
            }
            other => panic!("{other:?}"),
        }
    }
}

fn texture(
    label: &str,
    size: wgpu::Extent3d,
    format: wgpu::TextureFormat,
) -> wgpu::TextureDescriptor<'_> {
    wgpu::TextureDescriptor {
        label: Some(label),
        size,
        mip_level_count: 1,
        sample_count: 1,
        dimension: wgpu::TextureDimension::D2,
        format,
        usage: wgpu::TextureUsages::COPY_SRC | wgpu::TextureUsages::COPY_DST,
        view_formats: &[],
    }
}

#[test]
fn a_validation_error_names_the_pass_and_leaves_the_device_usable() {
    let Some(gpu) = own_gpu() else { return };
    let result = gpu.allocate("a pass of mine", || {
        let conflicting = wgpu::BufferUsages::MAP_READ | wgpu::BufferUsages::MAP_WRITE;
        gpu.device.create_buffer(&wgpu::BufferDescriptor {
            label: Some("conflicting"),
            size: 16,
            usage: conflicting | wgpu::BufferUsages::STORAGE,
            mapped_at_creation: false,
        })
    });
    match result {
        Err(GpuError::Pass { pass, .. }) => assert_eq!(pass, "a pass of mine"),
        other => panic!("{other:?}"),
    }
    assert_eq!(copied(&gpu, &[1, 2, 3]), [2, 3, 4]);
}

#[test]
fn an_error_in_a_frame_names_the_pipeline() {
    let Some(gpu) = own_gpu() else { return };
    let kernel = copy_kernel(&gpu);
    let mut frame = Frame::new(&gpu, false);
    // No bind group is set.
    frame.compute("the faulty pass", |pass| {
        kernel.dispatch(pass, &[], [1, 1, 1])
    });
    let error = frame.submit().unwrap_err().to_string();
    assert!(error.contains("testing.copy.main"), "{error}");
    // The error is reported once.
    assert_eq!(gpu.check(), Ok(()));
    assert_eq!(copied(&gpu, &[1, 2, 3]), [2, 3, 4]);
}

/// A separate device: errors that no call returns would otherwise reach a test that runs at the same time.
fn own_gpu() -> Option<Gpu> {
    test_gpu().map(|_| Gpu::open(&super::AdapterChoice::Best).unwrap())
}

#[test]
fn a_pipeline_that_does_not_compile_is_reported_with_its_label() {
    let Some(gpu) = own_gpu() else { return };
    let shader = super::Shader {
        name: "testing.broken",
        source: "@compute @workgroup_size(1) fn main() { let broken: u32 = 1.5; }".into(),
    };
    let kernel = Kernel::new(&gpu, &shader, "main", None);
    while gpu.is_compiling() {
        std::thread::yield_now();
    }
    let error = kernel
        .map(|_| gpu.check().unwrap_err())
        .unwrap_or_else(|error| error);
    assert!(error.to_string().contains("testing.broken"), "{error}");
}

#[test]
fn a_read_back_arrives_without_blocking() {
    let Some(gpu) = test_gpu() else { return };
    let buffer = gpu.storage("numbers", &[5_u32, 6, 7]).unwrap();
    let mut frame = Frame::new(&gpu, false);
    let on_the_way = frame.read_back::<u32>(&buffer, 12).unwrap();
    assert!(on_the_way.get().is_none(), "the frame is not submitted yet");
    // Later writes do not reach a copy made earlier.
    frame.clear(&buffer);
    frame.submit().unwrap();
    let numbers = loop {
        if let Some(numbers) = on_the_way.get() {
            break numbers.unwrap();
        }
    };
    assert_eq!(numbers, [5, 6, 7]);
    assert_eq!(pollster::block_on(on_the_way).unwrap(), [5, 6, 7]);
}

fn copied(gpu: &Gpu, words: &[u32]) -> Vec<u32> {
    let source = gpu.storage("source", words).unwrap();
    let count = words.len();
    run_kernel(
        gpu,
        &shader!("testing.copy"),
        "main",
        &[("source", &source)],
        count,
        count as u32,
    )
    .unwrap()
}

#[test]
fn buffers_of_any_size_come_back_as_they_were() {
    let Some(gpu) = test_gpu() else { return };
    for size in [0_usize, 1, 2, 3, 5, 13, 64, 257] {
        let bytes: Vec<u8> = (0..size).map(|index| (index * 7 + 1) as u8).collect();
        let buffer = gpu.storage("bytes", &bytes).unwrap();
        let back: Vec<u8> = read_buffer(&gpu, &buffer, size as u64).unwrap();
        assert_eq!(back, bytes, "{size} bytes");
    }
    let words: Vec<u32> = (0..1001).collect();
    let grown: Vec<u32> = (1..1002).collect();
    assert_eq!(copied(&gpu, &words), grown);
}

/// Scenes without lights, texels without triangles: what counts nothing is bound all the same.
#[test]
fn a_buffer_of_nothing_has_room_for_an_element_of_any_array() {
    let mut arrays = 0;
    for shader in shaders() {
        let module = shader.parse().unwrap();
        let mut layouter = naga::proc::Layouter::default();
        layouter.update(module.to_ctx()).unwrap();
        for (_, variable) in module.global_variables.iter() {
            let ty = &module.types[variable.ty].inner;
            if !matches!(variable.space, naga::AddressSpace::Storage { .. })
                || !ty.is_dynamically_sized(&module.types)
            {
                continue;
            }
            arrays += 1;
            let size = u64::from(layouter[variable.ty].size);
            assert!(size <= super::EMPTY_BYTES, "{}: {variable:?}", shader.name);
        }
    }
    assert!(arrays > 100, "{arrays}");
    let Some(gpu) = test_gpu() else { return };
    let storage = wgpu::BufferUsages::STORAGE;
    let sizes = [0, 1].map(|size| gpu.buffer("few bytes", size, storage).unwrap().size());
    assert_eq!(sizes, [super::EMPTY_BYTES, 16]);
}

#[test]
fn textures_of_any_size_come_back_as_they_were() {
    let Some(gpu) = test_gpu() else { return };
    for (width, height, format, texel) in [
        (7, 5, wgpu::TextureFormat::R8Unorm, 1),
        (1, 1, wgpu::TextureFormat::Rgba8Unorm, 4),
        (65, 3, wgpu::TextureFormat::Rgba8Unorm, 4),
        (33, 2, wgpu::TextureFormat::Rg32Uint, 8),
        (64, 1, wgpu::TextureFormat::Rgba32Float, 16),
    ] {
        let size = wgpu::Extent3d {
            width,
            height,
            depth_or_array_layers: 3,
        };
        let texture = gpu.texture(&texture("odd", size, format)).unwrap();
        let layer_bytes = (width * height * texel) as usize;
        let bytes: Vec<u8> = (0..layer_bytes * 3)
            .map(|index| (index % 251) as u8)
            .collect();
        let layout = wgpu::TexelCopyBufferLayout {
            offset: 0,
            bytes_per_row: Some(width * texel),
            rows_per_image: Some(height),
        };
        gpu.queue
            .write_texture(texture.as_image_copy(), &bytes, layout, size);
        for layer in 0..3 {
            let back: Vec<u8> =
                read_texture(&gpu, &texture, wgpu::TextureAspect::All, layer, 0).unwrap();
            let start = layer as usize * layer_bytes;
            assert!(
                back == bytes[start..start + layer_bytes],
                "{width} x {height} {format:?}, layer {layer}"
            );
        }
    }
}

#[test]
fn every_pass_of_a_timed_frame_has_a_time() {
    let Some(gpu) = test_gpu() else { return };
    let kernel = copy_kernel(&gpu);
    let source = gpu.storage("source", &[1_u32; 4]).unwrap();
    let output = gpu
        .buffer("output", 16, wgpu::BufferUsages::STORAGE)
        .unwrap();
    let resources = [
        ("source", source.as_entire_binding()),
        ("output", output.as_entire_binding()),
    ];
    let group = kernel.bind(&gpu, 0, &resources).unwrap();
    for timed in [false, true] {
        let mut frame = Frame::new(&gpu, timed);
        for name in ["first", "second"] {
            frame.clear(&output);
            frame.compute(name, |pass| {
                kernel.dispatch(pass, &[(0, &group)], [4, 1, 1])
            });
        }
        let timings = frame.submit().unwrap().wait().unwrap();
        let names: Vec<&str> = timings.iter().map(|timing| timing.pass.as_str()).collect();
        if timed && gpu.has_timestamps {
            assert_eq!(names, ["first", "second"]);
            assert!(
                timings
                    .iter()
                    .all(|timing| (0.0..60_000.0).contains(&timing.milliseconds))
            );
        } else {
            assert!(names.is_empty());
        }
    }
}

/// Writes that change nothing are skipped, those that change something arrive, and a shorter write leaves the rest.
#[test]
fn host_buffers_upload_what_changes() {
    let Some(gpu) = own_test_gpu() else { return };
    let buffer = HostBuffer::new(&gpu, "test", 16, wgpu::BufferUsages::STORAGE).unwrap();
    let uploads = |data: &[u32]| {
        let before = gpu.uploaded_bytes();
        buffer.write(&gpu, data);
        gpu.uploaded_bytes() - before
    };
    assert_eq!(uploads(&[1, 2, 3, 4]), 16);
    assert_eq!(uploads(&[1, 2, 3, 4]), 0);
    assert_eq!(uploads(&[1, 2]), 0);
    assert_eq!(uploads(&[1, 5]), 8);
    assert_eq!(uploads(&[1, 5, 3, 4]), 0);
    assert_eq!(uploads(&[1, 5, 3, 6]), 16);
    let held: Vec<u32> = read_buffer(&gpu, &buffer, 16).unwrap();
    assert_eq!(held, [1, 5, 3, 6]);
}
