//! Entry points, their clusters, and light samples.

use glam::{Mat3, Vec2, Vec3};
use gpugi_scene::Scene;
use gpugi_scene::provoking::provoking_order;

use super::clusters::{halves, mean, nearest, refine};

/// A point of a surface at which direct light enters.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Entry {
    /// World space (m).
    pub position: Vec3,
    /// Unit normal of the triangle's front.
    pub normal: Vec3,
    pub instance: u32,
    pub triangle: u32,
    /// Weights of the second and the third corner, in the order of the scene's tables.
    pub barycentrics: Vec2,
}

/// Entry points, cluster by cluster.
#[derive(Debug, Clone, PartialEq, Default)]
pub(super) struct Entries {
    pub entries: Vec<Entry>,
    /// First entry point of each cluster, and behind the last one the number of all.
    pub firsts: Vec<u32>,
    /// Further points at which the light is sampled, cluster by cluster.
    pub samples: Vec<Entry>,
    /// First light sample of each cluster, counted from the first entry point, and behind the last one the end of all.
    pub first_samples: Vec<u32>,
    /// Area that each entry point stands for (m^2).
    pub area: f32,
    /// Distance that counts as much as normals which differ by 1 (m).
    pub normal_scale: f32,
}

/// A triangle in world space.
struct Triangle {
    corners: [Vec3; 3],
    front: Vec3,
    instance: u32,
    number: u32,
}

/// Numbers by which transfer compares entry points: `PROBES` of columns.wesl.
pub(super) const COLUMN: usize = 64;

impl Entries {
    /// `count` points, spread evenly over the scene's surfaces, in `clusters` clusters, and `samples` light samples;
    /// none of them where the scene has no surfaces.
    pub fn new(scene: &Scene, count: u32, samples: u32, clusters: u32) -> Self {
        let (triangles, sums) = triangles(scene);
        let all = sums.last().copied().unwrap_or(0.0);
        if triangles.is_empty() || !(all as f32).is_finite() {
            return Self::default();
        }
        let entries = spread(&triangles, &sums, count);
        let mut made = Self {
            samples: spread(&triangles, &sums, samples),
            area: (all / f64::from(count)) as f32,
            normal_scale: normal_scale(all, clusters),
            ..Self::default()
        };
        let sites = made.sites(&entries);
        let mut groups = halves(&sites, (0..entries.len()).collect(), clusters as usize);
        refine(&sites, &mut groups);
        let means: Vec<_> = groups.iter().map(|group| mean(&sites, group)).collect();
        let samples = nearest(&made.sites(&made.samples), &means);
        made.entries = entries;
        made.divide(&groups, &samples);
        made
    }

    /// Clusters the entry points by rows of numbers, one row per entry point, instead: k-means, from the clusters that
    /// there are.
    pub fn cluster_by(&mut self, columns: &[[f32; COLUMN]]) {
        let ends = self.firsts.windows(2);
        let mut groups: Vec<Vec<usize>> = ends
            .map(|ends| (ends[0] as usize..ends[1] as usize).collect())
            .collect();
        refine(columns, &mut groups);
        // These clusters have no place: a light sample follows the nearest entry point.
        let of_entries = nearest(&self.sites(&self.samples), &self.sites(&self.entries));
        let of_group = |group: &Vec<usize>| {
            let samples = group.iter().flat_map(|&entry| of_entries[entry].iter());
            samples.copied().collect()
        };
        let samples: Vec<Vec<usize>> = groups.iter().map(of_group).collect();
        self.divide(&groups, &samples);
    }

    /// Sorts the entry points and the light samples by their groups.
    fn divide(&mut self, entries: &[Vec<usize>], samples: &[Vec<usize>]) {
        let count = self.entries.len();
        (self.entries, self.firsts) = by_group(&self.entries, entries, 0);
        (self.samples, self.first_samples) = by_group(&self.samples, samples, count);
    }

    /// What k-means compares: places, and normals as places.
    fn sites(&self, points: &[Entry]) -> Vec<[f32; 6]> {
        let site = |point: &Entry| {
            let (place, normal) = (point.position, point.normal * self.normal_scale);
            [place.x, place.y, place.z, normal.x, normal.y, normal.z]
        };
        points.iter().map(site).collect()
    }

    /// Number of clusters.
    pub fn clusters(&self) -> u32 {
        self.firsts.len().saturating_sub(1) as u32
    }

    /// Entry points, then light samples.
    pub fn points(&self) -> impl Iterator<Item = &Entry> {
        self.entries.iter().chain(&self.samples)
    }

    /// The entry points with the numbers of their clusters.
    pub fn with_clusters(&self) -> impl Iterator<Item = (&Entry, u32)> {
        let clusters = self.firsts.windows(2).zip(0..);
        let clusters =
            clusters.flat_map(|(ends, cluster)| (ends[0]..ends[1]).map(move |_| cluster));
        self.entries.iter().zip(clusters)
    }
}

/// The distance that counts as much as normals which differ by 1, about the radius of a cluster: a right angle counts as
/// much as being 1.4 radii apart (m). `all`: area of all surfaces (m^2).
pub(super) fn normal_scale(all: f64, clusters: u32) -> f32 {
    (all as f32 / std::f32::consts::PI / clusters as f32).sqrt()
}

/// Area of all surfaces (m^2).
pub(super) fn surface_area(scene: &Scene) -> f64 {
    triangles(scene).1.last().copied().unwrap_or(0.0)
}

/// All triangles that have an area, with the sums of their areas (m^2).
fn triangles(scene: &Scene) -> (Vec<Triangle>, Vec<f64>) {
    let (mut triangles, mut sums) = (Vec::new(), Vec::new());
    let mut sum = 0.0;
    for (instance, placed) in scene.instances.iter().enumerate() {
        let mesh = &scene.meshes[placed.mesh];
        let order = provoking_order(&mesh.indices, mesh.positions.len());
        let is_mirrored = Mat3::from_mat4(placed.world_from_mesh).determinant() < 0.0;
        for (number, corners) in order.indices.as_chunks::<3>().0.iter().enumerate() {
            let corners = corners.map(|vertex| {
                let position = mesh.positions[order.vertices[vertex as usize] as usize];
                placed.world_from_mesh.transform_point3(position)
            });
            let across = (corners[1] - corners[0]).cross(corners[2] - corners[0]);
            let area = f64::from(across.length()) / 2.0;
            let Some(normal) = across.try_normalize().filter(|_| area.is_finite()) else {
                continue;
            };
            sum += area;
            sums.push(sum);
            triangles.push(Triangle {
                corners,
                front: if is_mirrored { -normal } else { normal },
                instance: instance as u32,
                number: number as u32,
            });
        }
    }
    (triangles, sums)
}

/// The points sorted by their groups, and the first of each group, counted from `start`, with the end of all.
fn by_group(points: &[Entry], groups: &[Vec<usize>], start: usize) -> (Vec<Entry>, Vec<u32>) {
    let mut firsts = vec![start as u32];
    let mut sorted = Vec::with_capacity(points.len());
    for group in groups {
        sorted.extend(group.iter().map(|&index| points[index]));
        firsts.push((start + sorted.len()) as u32);
    }
    (sorted, firsts)
}

/// `count` points by area: those of Hammersley's set choose a triangle by their first coordinate, and a place in it by
/// what is left of that coordinate and by the second one. `sums`: sums of the triangles' areas (m^2).
fn spread(triangles: &[Triangle], sums: &[f64], count: u32) -> Vec<Entry> {
    let all = sums.last().copied().unwrap_or(0.0);
    let entry = |index: u32| {
        let at = (f64::from(index) + 0.5) / f64::from(count) * all;
        let chosen = sums.partition_point(|&sum| sum <= at).min(sums.len() - 1);
        let before = if chosen == 0 { 0.0 } else { sums[chosen - 1] };
        let triangle = &triangles[chosen];
        let rest = ((at - before) / (sums[chosen] - before)) as f32;
        let second = (f64::from(index.reverse_bits()) + 0.5) / (f64::from(u32::MAX) + 1.0);
        let barycentrics = on_triangle(rest, second as f32);
        let [a, b, c] = triangle.corners;
        Entry {
            position: a + (b - a) * barycentrics.x + (c - a) * barycentrics.y,
            normal: triangle.front,
            instance: triangle.instance,
            triangle: triangle.number,
            barycentrics,
        }
    };
    (0..count).map(entry).collect()
}

/// Barycentrics that are evenly distributed if the coordinates are (Heitz 2019).
fn on_triangle(u: f32, v: f32) -> Vec2 {
    if v > u {
        Vec2::new(u / 2.0, v - u / 2.0)
    } else {
        Vec2::new(u - v / 2.0, v / 2.0)
    }
}
