//! Grids of points.

use glam::{UVec3, Vec3, vec3};
use gpugi_scene::Bounds;

use super::Grid;

fn bounds(min: Vec3, max: Vec3) -> Bounds {
    Bounds { min, max }
}

/// Points lie in the bounds, none in a plane that halves them, and neighbours are as far apart as cells are wide.
#[test]
fn points_fill_the_bounds() {
    let (low, high) = (vec3(-1.0, 0.0, 2.0), vec3(3.0, 1.0, 4.5));
    for density in [0.0, 0.3, 1.0, 2.5] {
        let grid = Grid::new(&bounds(low, high), density);
        let points: Vec<Vec3> = grid.points().collect();
        assert_eq!(points.len() as u64, grid.len(), "{density}");
        for point in &points {
            assert!(point.cmpgt(low).all() && point.cmplt(high).all(), "{point}");
            let off_middle = (*point - (low + high) * 0.5).abs();
            assert!(off_middle.min_element() > 1e-3, "{point}");
        }
        let width = (high - low) / grid.counts.as_vec3();
        assert!((grid.spacing - width).abs().max_element() < 1e-5);
        let last = grid.spacing * (grid.counts - 1).as_vec3();
        assert!(points[points.len() - 1].distance(points[0] + last) < 1e-4);
    }
    assert_eq!(
        Grid::new(&bounds(low, high), 1.0).counts,
        UVec3::new(4, 1, 3)
    );
}

/// Without a density there are about 64 points, whatever the shape.
#[test]
fn a_scene_has_about_64_points() {
    for extent in [
        Vec3::ONE,
        vec3(10.0, 1.0, 10.0),
        vec3(1.0, 50.0, 1.0),
        Vec3::splat(1e4),
    ] {
        let count = Grid::new(&bounds(Vec3::ZERO, extent), 0.0).len();
        assert!((27..=64).contains(&count), "{extent}: {count}");
    }
}

/// Bounds without extent, and none at all.
#[test]
fn odd_bounds_have_points() {
    let flat = Grid::new(&bounds(Vec3::ZERO, vec3(4.0, 0.0, 4.0)), 1.0);
    assert_eq!(flat.counts, UVec3::new(4, 1, 4));
    let dot = Grid::new(&bounds(Vec3::ONE, Vec3::ONE), 0.0);
    let empty = Grid::new(&Bounds::EMPTY, 0.0);
    for grid in [flat, dot, empty] {
        assert!(grid.spacing.min_element() > 0.0 && grid.points().all(Vec3::is_finite));
    }
    assert_eq!([dot.len(), empty.len()], [1, 1]);
    assert!(Grid::new(&bounds(Vec3::ZERO, Vec3::ONE), 1e6).len() > 1 << 50);
}
