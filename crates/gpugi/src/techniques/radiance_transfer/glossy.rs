//! Transfer matrices of the texels of glossy objects, and the light that their lobes reflect (tutorial equation 22).

use std::ops::Range;

use gpugi_scene::MaterialModel;

use super::gpu::{COEFFICIENT_BYTES, LANES, MatrixWork, Slots};
use super::places::{Piece, Places};
use super::{Cut, Settings};
use crate::capture::Receiver;
use crate::capture::atlas::TexelGather;
use crate::gpu::{Frame, Gpu, GpuError, Kernel, Named, join, read_buffer};
use crate::scene::{Claims, GpuScene, Object};
use crate::shader;

/// `NO_COEFFICIENTS` of glossy/gather.wesl.
const NO_COEFFICIENTS: u32 = u32::MAX;

/// An object with matrices: its instance, and whether its lobe is Phong's.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct GlossyObject {
    pub instance: usize,
    pub is_phong: bool,
}

/// The objects of the list that have a glossy lobe and transmit no light.
pub(super) fn objects(settings: &Settings, scene: &GpuScene) -> Vec<GlossyObject> {
    let Some(host) = scene.host().filter(|_| settings.is_glossy()) else {
        return Vec::new();
    };
    let is_wanted = |object: &Object| {
        let has_lobe = !object.is_diffuse && !object.is_smooth && !object.is_transmissive;
        has_lobe && object.is_named_by(&settings.glossy)
    };
    let objects = scene.objects.iter().enumerate();
    let wanted = objects.filter(|(_, object)| is_wanted(object));
    let glossy = wanted.map(|(instance, _)| {
        let material = &host.materials[host.instances[instance].material];
        GlossyObject {
            instance,
            is_phong: matches!(material.model, MaterialModel::Phong { .. }),
        }
    });
    glossy.collect()
}

/// Transfer matrices. A texel that has one has a slot; slots follow texels.
#[derive(Debug)]
pub(super) struct Glossy {
    settings: Settings,
    parts: Vec<Part>,
    tiles: Vec<Tile>,
    /// `arriving` of glossy/gather.wesl.
    pub arriving: wgpu::Buffer,
    rays: Kernel,
    relight: Kernel,
    gather: TexelGather,
}

/// Slots whose matrices fit one buffer.
#[derive(Debug)]
struct Part {
    slots: u32,
    /// Where the coefficients of the first slot's light lie in `arriving`.
    first_word: u32,
    /// `matrices` of glossy/matrices.wesl.
    matrices: wgpu::Buffer,
}

/// Slots whose matrices are computed in one step.
#[derive(Debug)]
struct Tile {
    /// Number of the piece of the atlas that their points are in.
    piece: usize,
    part: usize,
    /// Counted from the part's first.
    slots: Range<u32>,
}

impl Glossy {
    /// Matrices for the points of `objects`.
    ///
    /// # Errors
    /// [`GpuError::Input`] with their size if there is no memory for them; [`GpuError`].
    pub fn new(
        gpu: &Gpu,
        scene: &GpuScene,
        settings: &Settings,
        objects: &[GlossyObject],
        places: &Places,
        cut: Cut,
    ) -> Result<Self, GpuError> {
        let texels = texels(objects, places);
        let made = Self::with_texels(gpu, scene, settings, &texels, places, cut);
        made.map_err(|error| match error {
            GpuError::OutOfMemory { .. } | GpuError::TooLarge { .. } => GpuError::Input {
                what: format!(
                    "radiance-transfer: {}, for which there is no memory; lower order or resolution, or choose fewer \
                     objects in glossy ({error})",
                    described(settings, texels.len()),
                ),
            },
            other => other,
        })
    }

    /// `texels`: texel and 1 for Phong's lobe, per slot, sorted.
    fn with_texels(
        gpu: &Gpu,
        scene: &GpuScene,
        settings: &Settings,
        texels: &[[u32; 2]],
        places: &Places,
        cut: Cut,
    ) -> Result<Self, GpuError> {
        let functions = settings.terms();
        let order = ("ORDER", f64::from(settings.order));
        let relight = shader!("techniques.radiance_transfer.glossy.relight");

        // Words of a binding are counted in 32 bits, too.
        let [width, height] = places.map_size();
        let all = width * height;
        let words = u64::from(all) + texels.len() as u64 * u64::from(functions) * 2;
        let arriving = gpu.room("light at glossy texels [bytes]", words * 4)?;
        let mut first_words = vec![NO_COEFFICIENTS; all as usize];
        for (slot, [texel, _]) in texels.iter().enumerate() {
            first_words[*texel as usize] = all + slot as u32 * functions * 2;
        }
        gpu.write(&arriving, 0, &first_words);

        let limits = gpu.limits();
        let limit = limits.max_buffer_size;
        let limit = limit.min(limits.max_storage_buffer_binding_size);
        let most = (limit / bytes_of_slot(settings)).max(1) as usize;
        let at_once = (cut.rays_of_step / 4 / settings.rays).max(1) as usize;
        let mut parts = Vec::new();
        for (number, texels) in texels.chunks(most).enumerate() {
            let bytes = texels.len() as u64 * bytes_of_slot(settings);
            let matrices = gpu.room("transfer matrices [bytes]", bytes)?;
            gpu.write(&matrices, 0, texels);
            parts.push(Part {
                slots: texels.len() as u32,
                first_word: all + (number * most) as u32 * functions * 2,
                matrices,
            });
        }
        let is_first = ("IS_FIRST", f64::from(u8::from(settings.bounces == 1)));
        let matrices = shader!("techniques.radiance_transfer.glossy.matrices");
        let rays = scene.ray_kernel(gpu, &matrices, &[order, is_first, places.constant()])?;
        let left_out = settings.left_out() | Claims::SPECULAR | Claims::GLOSSY | Claims::RAYS;
        let left_out = ("LEFT_OUT", f64::from(left_out.bits()));
        let gather = shader!("techniques.radiance_transfer.glossy.gather");
        let constants = [left_out, order, places.constant()];
        Ok(Self {
            settings: settings.clone(),
            tiles: tiles(texels, at_once, most, &places.pieces()),
            parts,
            rays,
            relight: Kernel::with_constants(gpu, &relight, "main", None, &[order])?,
            gather: TexelGather::new(gpu, scene, &gather, &constants)?,
            arriving,
        })
    }

    /// Steps that compute the matrices.
    pub fn steps(&self) -> u32 {
        self.tiles.len() as u32
    }

    /// Their number and size, in words.
    pub fn described(&self) -> String {
        let slots: u32 = self.parts.iter().map(|part| part.slots).sum();
        described(&self.settings, slots as usize)
    }

    /// Computes the matrices of one step, and returns its number of rays: pass `radiance-transfer.matrices`.
    ///
    /// # Errors
    /// [`GpuError`].
    pub fn record(
        &self,
        frame: &mut Frame<'_>,
        scene: &GpuScene,
        places: &Places,
        step: u32,
        vectors: &[Named<'_>],
    ) -> Result<u64, GpuError> {
        let Some(tile) = self.tiles.get(step as usize) else {
            return Ok(0);
        };
        let (piece, part) = (places.pieces()[tile.piece], &self.parts[tile.part]);
        let work = MatrixWork {
            first_texel: piece.first,
            first_slot: tile.slots.start,
            end_slot: tile.slots.end,
            slots: part.slots,
            rays: self.settings.rays,
            seed: self.settings.seed,
            padding_0: 0,
            padding_1: 0,
        };
        let work = frame.gpu.constant("transfer matrices", &work)?;
        let own: [Named<'_>; 3] = [
            ("work", &work),
            ("points", piece.points),
            ("matrices", &part.matrices),
        ];
        let slots = tile.slots.len() as u32;
        let (name, scene) = ("radiance-transfer.matrices", Some(&scene.ray_bind_group));
        let resources = join(vectors, &own);
        frame.run(name, &self.rays, scene, &resources, [slots * LANES, 1, 1])?;
        Ok(u64::from(slots) * u64::from(self.settings.rays))
    }

    /// Multiplies matrices and light, given by its coefficients: pass `radiance-transfer.glossy`.
    ///
    /// # Errors
    /// [`GpuError`].
    pub fn relight(&self, frame: &mut Frame<'_>, light: &wgpu::Buffer) -> Result<(), GpuError> {
        let gpu = frame.gpu;
        frame.compute("radiance-transfer.glossy", |pass| {
            for part in &self.parts {
                let slots = Slots {
                    count: part.slots,
                    first_word: part.first_word,
                    padding_0: 0,
                    padding_1: 0,
                };
                let slots = gpu.constant("glossy texels", &slots)?;
                let resources: [Named<'_>; 4] = [
                    ("light", light),
                    ("slots", &slots),
                    ("matrices", &part.matrices),
                    ("arriving", &self.arriving),
                ];
                let lanes = [part.slots * LANES, 1, 1];
                self.relight.run(pass, None, &resources, lanes)?;
            }
            Ok(())
        })
    }

    /// Adds what the objects reflect toward the receiver: pass `radiance-transfer.glossy-gather`.
    ///
    /// # Errors
    /// [`GpuError`].
    pub fn gather(
        &self,
        frame: &mut Frame<'_>,
        scene: &GpuScene,
        places: &Places,
        receiver: &Receiver,
    ) -> Result<(), GpuError> {
        let (name, texels) = ("radiance-transfer.glossy-gather", places.capture());
        let kept: [Named<'_>; 2] = [("atlas", places.lookup()), ("arriving", &self.arriving)];
        self.gather
            .record(frame, name, scene, texels, receiver, &kept)
    }

    /// Bytes of all buffers.
    pub fn bytes(&self) -> u64 {
        let matrices = self.parts.iter().map(|part| part.matrices.size());
        matrices.sum::<u64>() + self.arriving.size()
    }

    /// The matrices, for [`Glossy::resume`]. Waits for the GPU.
    ///
    /// # Errors
    /// [`GpuError`].
    pub fn save(&self, gpu: &Gpu) -> Result<Vec<Vec<u32>>, GpuError> {
        let read = |part: &Part| {
            let mut words = read_buffer(gpu, &part.matrices, part.matrices.size())?;
            Ok(words.split_off(part.texel_words()))
        };
        self.parts.iter().map(read).collect()
    }

    /// Whether `saved` has matrices of as many texels.
    pub fn fits(&self, saved: &[Vec<u32>]) -> bool {
        let words = |part: &Part| part.matrices.size() as usize / 4 - part.texel_words();
        saved.iter().map(Vec::len).eq(self.parts.iter().map(words))
    }

    /// Continues from saved matrices, which fit.
    pub fn resume(&self, gpu: &Gpu, saved: &[Vec<u32>]) {
        for (part, words) in self.parts.iter().zip(saved) {
            gpu.write(&part.matrices, part.texel_words() as u64 * 4, words);
        }
    }
}

impl Part {
    /// Words in front of the matrices.
    fn texel_words(&self) -> usize {
        2 * self.slots as usize
    }
}

/// Bytes of a slot: its texel, and its matrix.
fn bytes_of_slot(settings: &Settings) -> u64 {
    let functions = u64::from(settings.terms());
    (functions * functions + 1) * COEFFICIENT_BYTES
}

fn described(settings: &Settings, texels: usize) -> String {
    let bytes = texels as u64 * bytes_of_slot(settings);
    format!(
        "the transfer matrices of {texels} glossy texels take {} MiB",
        bytes.div_ceil(1 << 20)
    )
}

/// The texels of objects, and 1 for Phong's lobe, sorted.
fn texels(objects: &[GlossyObject], places: &Places) -> Vec<[u32; 2]> {
    let of_object = |object: &GlossyObject| {
        let is_phong = u32::from(object.is_phong);
        let texels = places.of_instance(object.instance).into_iter();
        texels.map(move |texel| [texel, is_phong])
    };
    let mut texels: Vec<_> = objects.iter().flat_map(of_object).collect();
    texels.sort_unstable();
    // Charts have gutters between them, so no texel belongs to two objects.
    texels.dedup_by_key(|[texel, _]| *texel);
    texels
}

/// Cuts the slots, of which `most` fit one buffer, into steps whose points are in one piece of the atlas.
fn tiles(texels: &[[u32; 2]], at_once: usize, most: usize, pieces: &[Piece<'_>]) -> Vec<Tile> {
    let mut tiles = Vec::new();
    for (piece, of_piece) in pieces.iter().enumerate() {
        let place = |point: u32| texels.partition_point(|[texel, _]| *texel < point);
        let (mut first, end) = (
            place(of_piece.first),
            place(of_piece.first + of_piece.count),
        );
        while first < end {
            let part = first / most;
            let to = end.min(first + at_once).min((part + 1) * most);
            let in_part = |slot: usize| (slot - part * most) as u32;
            tiles.push(Tile {
                piece,
                part,
                slots: in_part(first)..in_part(to),
            });
            first = to;
        }
    }
    tiles
}
