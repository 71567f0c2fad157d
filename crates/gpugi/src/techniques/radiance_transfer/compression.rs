//! Compression of transfer vectors by clustered principal component analysis (tutorial equation 20; Sloan, Hall, Hart
//! and Snyder 2003). Each cluster of texels has a mean and a few basis vectors, each texel a weight per basis vector.
//!
//! The GPU clusters the vectors by k-means, from seeds that are spread evenly over all normals. The host analyses the
//! clusters, one per step.

use half::f16;
use serde::{Deserialize, Serialize};

use super::Settings;
use super::gpu::{MOST_FUNCTIONS, Work};
use super::places::Places;
use super::principal::{Subspace, mean};
use super::transfer::are_finite;
use crate::gpu::{Frame, Gpu, GpuError, Kernel, Named, ReadBack, read_buffer};
use crate::shader;

/// Rounds of k-means: more change the error little.
const ROUNDS: u32 = 8;
/// `NO_CLUSTER` of numbers.wesl, and that of clusters/relight.wesl.
const NO_CLUSTER: u32 = u32::MAX;
const NO_CLUSTER_OF_TEXEL: u16 = u16::MAX;
/// `PARTS` of clusters/mean.wesl, and its lanes.
const PARTS: u32 = 64;
const LANES: u32 = 64;

/// Work toward compressed vectors.
#[derive(Debug)]
pub(super) struct Compression {
    settings: Settings,
    texels: u32,
    /// The cluster of each texel.
    clusters: wgpu::Buffer,
    normals: Kernel,
    mean: Kernel,
    sum: Kernel,
    assign: Kernel,
    stage: Stage,
}

#[derive(Debug)]
enum Stage {
    Begin,
    /// Groups of like normals are on their way to the host.
    Normals(Box<ReadBack<Vec<u32>>>),
    /// Rounds of k-means that are done; the means, and sums of parts of the texels.
    Rounds(u32, [wgpu::Buffer; 2]),
    /// Clusters and vectors are on their way to the host.
    Vectors(Box<[ReadBack<Vec<u32>>; 2]>),
    Analysis(Analysis),
}

/// Clusters that the host analyses.
#[derive(Debug)]
struct Analysis {
    /// Texels of each cluster.
    clusters: Vec<Vec<usize>>,
    /// All vectors.
    vectors: Vec<u32>,
    done: usize,
    found: Saved,
}

/// Compressed vectors on the host.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(super) struct Saved {
    /// Means and basis vectors: `vec2u` of coefficients.wesl, as clusters/dots.wesl reads them.
    pub subspaces: Vec<u32>,
    /// As clusters/relight.wesl reads them.
    pub weights: Vec<u32>,
}

impl Compression {
    pub fn new(gpu: &Gpu, settings: &Settings, texels: u32) -> Result<Self, GpuError> {
        let order = [("ORDER", f64::from(settings.order))];
        let kernel = |shader, entry| Kernel::with_constants(gpu, shader, entry, None, &order);
        let normals = shader!("techniques.radiance_transfer.clusters.normals");
        let mean = shader!("techniques.radiance_transfer.clusters.mean");
        let assign = shader!("techniques.radiance_transfer.clusters.assign");
        Ok(Self {
            clusters: gpu.room("clusters of texels", u64::from(texels) * 4)?,
            normals: Kernel::new(gpu, &normals, "main", None)?,
            sum: kernel(&mean, "sum")?,
            mean: kernel(&mean, "main")?,
            assign: kernel(&assign, "main")?,
            settings: settings.clone(),
            texels,
            stage: Stage::Begin,
        })
    }

    /// Part of the work that is done (0 to 1, not included).
    pub fn progress(&self) -> f32 {
        match &self.stage {
            Stage::Begin | Stage::Normals(_) => 0.0,
            Stage::Rounds(done, _) => 0.5 * *done as f32 / ROUNDS as f32,
            Stage::Vectors(_) => 0.5,
            Stage::Analysis(analysis) => {
                0.5 + 0.5 * analysis.done as f32 / (analysis.clusters.len() + 1) as f32
            }
        }
    }

    /// Takes a step, and returns the compressed vectors once they are ready: pass `radiance-transfer.clusters`. Does
    /// nothing while data is on its way to the host.
    ///
    /// # Errors
    /// [`GpuError`].
    pub fn step(
        &mut self,
        frame: &mut Frame<'_>,
        places: &Places,
        vectors: &wgpu::Buffer,
    ) -> Result<Option<Saved>, GpuError> {
        match &mut self.stage {
            Stage::Begin => {
                self.group_normals(frame, places)?;
                let groups = frame.read_back(&self.clusters, u64::from(self.texels) * 4)?;
                self.stage = Stage::Normals(Box::new(groups));
            }
            Stage::Normals(groups) => {
                if let Some(groups) = groups.get() {
                    let means = self.seed(frame.gpu, &groups?)?;
                    self.stage = Stage::Rounds(0, means);
                }
            }
            Stage::Rounds(ROUNDS, _) => {
                let clusters = frame.read_back(&self.clusters, u64::from(self.texels) * 4)?;
                let vectors = frame.read_back(vectors, vectors.size())?;
                self.stage = Stage::Vectors(Box::new([clusters, vectors]));
            }
            Stage::Rounds(done, means) => {
                *done += 1;
                let means = means.clone();
                self.round(frame, vectors, &means)?;
            }
            Stage::Vectors(read) => {
                let [clusters, vectors] = read.as_ref();
                if let (Some(clusters), Some(vectors)) = (clusters.get(), vectors.get()) {
                    let analysis = Analysis::new(&self.settings, &clusters?, vectors?);
                    self.stage = Stage::Analysis(analysis);
                }
            }
            Stage::Analysis(analysis) => {
                if analysis.done == analysis.clusters.len() {
                    return Ok(Some(analysis.found.clone()));
                }
                analysis.step(&self.settings);
            }
        }
        Ok(None)
    }

    fn group_normals(&self, frame: &mut Frame<'_>, places: &Places) -> Result<(), GpuError> {
        for piece in places.pieces() {
            let work = Work {
                first_texel: piece.first,
                end_point: piece.count,
                ..bytemuck::Zeroable::zeroed()
            };
            let work = frame.gpu.constant("points of a piece", &work)?;
            let resources: [Named<'_>; 3] = [
                ("work", &work),
                ("points", piece.points),
                ("clusters", &self.clusters),
            ];
            let (name, count) = ("radiance-transfer.clusters", [piece.count, 1, 1]);
            frame.run(name, &self.normals, None, &resources, count)?;
        }
        Ok(())
    }

    /// Leaves one texel in each cluster, evenly spread over the texels in the order of their groups. Returns buffers for
    /// means and for sums of parts.
    fn seed(&self, gpu: &Gpu, groups: &[u32]) -> Result<[wgpu::Buffer; 2], GpuError> {
        let mut texels: Vec<usize> = (0..groups.len())
            .filter(|&texel| groups[texel] != NO_CLUSTER)
            .collect();
        texels.sort_by_key(|&texel| groups[texel]);
        let most = texels.len() / self.settings.minimum as usize;
        let count = most.clamp(1, self.settings.clusters as usize);
        let mut seeds = vec![NO_CLUSTER; groups.len()];
        if !texels.is_empty() {
            for cluster in 0..count {
                seeds[texels[cluster * texels.len() / count]] = cluster as u32;
            }
        }
        gpu.write(&self.clusters, 0, &seeds);
        let bytes = (count * MOST_FUNCTIONS as usize * 16) as u64;
        Ok([
            gpu.room("means of clusters [bytes]", bytes)?,
            gpu.room("sums of clusters [bytes]", bytes * u64::from(PARTS))?,
        ])
    }

    /// A round of k-means: the means of the clusters, then the nearest mean of each texel.
    fn round(
        &self,
        frame: &mut Frame<'_>,
        vectors: &wgpu::Buffer,
        [means, parts]: &[wgpu::Buffer; 2],
    ) -> Result<(), GpuError> {
        let resources: [Named<'_>; 4] = [
            ("vectors", vectors),
            ("clusters", &self.clusters),
            ("means", means),
            ("parts", parts),
        ];
        let clusters = (means.size() / 16) as u32 / MOST_FUNCTIONS;
        frame.compute("radiance-transfer.clusters", |pass| {
            let lanes = [PARTS * LANES, clusters, 1];
            self.mean.run(pass, None, &resources, lanes)?;
            self.sum.run(pass, None, &resources, [LANES, clusters, 1])?;
            self.assign.run(pass, None, &resources, [self.texels, 1, 1])
        })
    }
}

/// A transfer vector as numbers: red, green and blue of each function.
fn numbers(words: &[u32]) -> Vec<f32> {
    let half = |word: u32| f16::from_bits(word as u16).to_f32();
    let rgb = |pair: &[u32]| [half(pair[0]), half(pair[0] >> 16), half(pair[1])];
    words.chunks_exact(2).flat_map(rgb).collect()
}

/// Two 16-bit floats in a word.
fn pack(low: f32, high: f32) -> u32 {
    u32::from(f16::from_f32(low).to_bits()) | u32::from(f16::from_f32(high).to_bits()) << 16
}

impl Analysis {
    /// `assigned`: the cluster of each texel. Clusters with fewer than the minimum of points join the others.
    fn new(settings: &Settings, assigned: &[u32], vectors: Vec<u32>) -> Self {
        let count = assigned
            .iter()
            .filter(|&&cluster| cluster != NO_CLUSTER)
            .max();
        let count = count.map_or(0, |&most| most as usize + 1);
        let mut clusters = vec![Vec::new(); count];
        for (texel, &cluster) in assigned.iter().enumerate() {
            if cluster != NO_CLUSTER {
                clusters[cluster as usize].push(texel);
            }
        }
        let mut analysis = Self {
            clusters,
            vectors,
            done: 0,
            found: Saved {
                subspaces: Vec::new(),
                weights: vec![
                    u32::from(NO_CLUSTER_OF_TEXEL);
                    assigned.len() * settings.words_of_weights() as usize
                ],
            },
        };
        analysis.join_small(settings);
        if analysis.clusters.is_empty() {
            // No texel has a point, but bindings are never empty.
            analysis
                .found
                .subspaces
                .resize(settings.words_of_cluster(), 0);
        }
        analysis
    }

    fn vector(&self, settings: &Settings, texel: usize) -> Vec<f32> {
        let words = 2 * settings.terms() as usize;
        numbers(&self.vectors[texel * words..][..words])
    }

    /// While there are clusters of fewer points than the minimum, gives the points of the smallest one to the clusters
    /// with the nearest means.
    fn join_small(&mut self, settings: &Settings) {
        let mut clusters = std::mem::take(&mut self.clusters);
        clusters.retain(|texels| !texels.is_empty());
        let vector = |&texel: &usize| self.vector(settings, texel);
        let mut means: Vec<Vec<f64>> = clusters
            .iter()
            .map(|texels| mean(texels.iter().map(vector)))
            .collect();
        while clusters.len() > 1 {
            let sizes = clusters.iter().map(Vec::len).enumerate();
            let smallest = sizes.min_by_key(|&(_, size)| size);
            let Some((smallest, _)) =
                smallest.filter(|smallest| smallest.1 < settings.minimum as usize)
            else {
                break;
            };
            means.remove(smallest);
            for texel in clusters.remove(smallest) {
                let vector = vector(&texel);
                let squared = |mean: &Vec<f64>| -> f64 {
                    let pairs = vector.iter().zip(mean);
                    pairs
                        .map(|(value, mean)| (f64::from(*value) - mean).powi(2))
                        .sum()
                };
                let squares = means.iter().map(squared).enumerate();
                let nearest = squares.min_by(|a, b| a.1.total_cmp(&b.1));
                clusters[nearest.map_or(0, |nearest| nearest.0)].push(texel);
            }
        }
        self.clusters = clusters;
    }

    /// Analyses the next cluster.
    fn step(&mut self, settings: &Settings) {
        let texels = &self.clusters[self.done];
        let vectors: Vec<_> = texels
            .iter()
            .map(|&texel| self.vector(settings, texel))
            .collect();
        let count = settings.components as usize;
        let mut subspace = Subspace::new(&vectors, count);
        // A vector has no more components than numbers.
        subspace.basis.resize(count, vec![0.0; subspace.mean.len()]);
        for vector in std::iter::once(&mut subspace.mean).chain(&mut subspace.basis) {
            for rgb in vector.chunks_exact_mut(3) {
                let words = [pack(rgb[0], rgb[1]), pack(rgb[2], 0.0)];
                self.found.subspaces.extend(words);
                // Weights are those of the vectors as they are stored.
                rgb.copy_from_slice(&numbers(&words));
            }
        }
        for (&texel, vector) in texels.iter().zip(&vectors) {
            let weights = subspace.weights(vector).into_iter().map(f16::from_f32);
            let halves: Vec<u16> = std::iter::once(self.done as u16)
                .chain(weights.map(f16::to_bits))
                .collect();
            let words = settings.words_of_weights() as usize;
            let into = &mut self.found.weights[texel * words..][..words];
            for (word, halves) in into.iter_mut().zip(halves.chunks(2)) {
                let high = halves.get(1).copied().unwrap_or(0);
                *word = u32::from(halves[0]) | u32::from(high) << 16;
            }
        }
        self.done += 1;
    }
}

/// Compressed vectors on the GPU.
#[derive(Debug)]
pub(super) struct Compressed {
    subspaces: wgpu::Buffer,
    weights: wgpu::Buffer,
    /// Bytes of both that are in use: buffers are padded.
    used: [u64; 2],
    /// The light times all means and basis vectors: `vec4f`.
    dots: wgpu::Buffer,
    dot: Kernel,
    relight: Kernel,
}

impl Compressed {
    pub fn new(gpu: &Gpu, settings: &Settings, saved: &Saved) -> Result<Self, GpuError> {
        let terms = u64::from(settings.terms());
        let vectors = saved.subspaces.len() as u64 / (2 * terms);
        let relight = shader!("techniques.radiance_transfer.clusters.relight");
        let dot = shader!("techniques.radiance_transfer.clusters.dots");
        let kernel = |shader, name, value: u32| {
            Kernel::with_constants(gpu, shader, "main", None, &[(name, f64::from(value))])
        };
        Ok(Self {
            dot: kernel(&dot, "ORDER", settings.order)?,
            relight: kernel(&relight, "COMPONENTS", settings.components)?,
            used: [&saved.subspaces, &saved.weights].map(|words| words.len() as u64 * 4),
            subspaces: gpu.storage("means and basis vectors [bytes]", &saved.subspaces)?,
            weights: gpu.storage("weights of texels [bytes]", &saved.weights)?,
            dots: gpu.room("light of clusters [bytes]", vectors * 16)?,
        })
    }

    /// Bytes of all buffers.
    pub fn bytes(&self) -> u64 {
        self.subspaces.size() + self.weights.size() + self.dots.size()
    }

    /// Computes the irradiance of all texels: pass `radiance-transfer.relight`.
    pub fn relight(
        &self,
        frame: &mut Frame<'_>,
        light: &wgpu::Buffer,
        irradiance: &wgpu::Buffer,
    ) -> Result<(), GpuError> {
        let resources: [Named<'_>; 5] = [
            ("light", light),
            ("vectors", &self.subspaces),
            ("dots", &self.dots),
            ("weights", &self.weights),
            ("irradiance", irradiance),
        ];
        frame.compute("radiance-transfer.relight", |pass| {
            let count = (self.dots.size() / 16) as u32;
            self.dot.run(pass, None, &resources, [count, 1, 1])?;
            let texels = (irradiance.size() / 16) as u32;
            self.relight.run(pass, None, &resources, [texels, 1, 1])
        })
    }

    /// The vectors, for resuming. Waits for the GPU.
    ///
    /// # Errors
    /// [`GpuError`].
    pub fn save(&self, gpu: &Gpu) -> Result<Saved, GpuError> {
        Ok(Saved {
            subspaces: read_buffer(gpu, &self.subspaces, self.used[0])?,
            weights: read_buffer(gpu, &self.weights, self.used[1])?,
        })
    }
}

impl Saved {
    /// Whether these are compressed vectors of so many texels, with these settings.
    pub fn fits(&self, settings: &Settings, texels: u64) -> bool {
        let words = settings.words_of_weights() as usize;
        let of_cluster = settings.words_of_cluster();
        let clusters = self.subspaces.len() / of_cluster;
        let is_texel = |texel: &[u32]| {
            let number = texel[0] as u16;
            let is_cluster = usize::from(number) < clusters && are_finite(texel[0] >> 16);
            number == NO_CLUSTER_OF_TEXEL
                || (is_cluster && texel[1..].iter().copied().all(are_finite))
        };
        self.weights.len() as u64 == texels * words as u64
            && clusters > 0
            && clusters * of_cluster == self.subspaces.len()
            && self.weights.chunks(words).all(is_texel)
            && self.subspaces.iter().copied().all(are_finite)
    }
}
