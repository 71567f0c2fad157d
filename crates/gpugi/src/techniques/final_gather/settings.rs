//! What can be set.

crate::choices! {
    /// Where reference points are.
    pub enum ReferencePoints {
        /// In a grid; where another technique adds all indirect light, in the objects.
        Auto = "auto",
        /// In a grid, in the scene's bounds: they light everything.
        Grid = "grid",
        /// In the centre of each object: they light these objects alone.
        Objects = "objects",
        /// One, where the camera is: it lights everything.
        Camera = "camera",
    }
}

crate::choices! {
    /// How the solid angle of an area light is estimated where it is not seen from its reference point.
    pub enum SolidAngle {
        /// The tutorial's: a disc that is seen everywhere under the same angle as from the reference point.
        Disc = "disc",
        /// A disc in the surface, foreshortened by the angle under which it is seen.
        Oriented = "oriented",
        /// The exact form factor of the quadrilateral that a texel sees of a plane.
        Quad = "quad",
    }
}

crate::choices! {
    /// Whether lights are tested for being seen.
    pub enum Visibility {
        /// Light passes through what stands between.
        None = "none",
        /// Ways count that the reference point sees from end to end.
        Distance = "distance",
    }
}

crate::choices! {
    /// How many reference points of a grid light a point.
    pub enum Blend {
        /// The eight around it.
        All = "all",
        /// One of them, drawn by its weight: pictures are noisy until samples accumulate.
        Drawn = "drawn",
    }
}

crate::settings! {
    /// Settings of final gathering.
    pub struct Settings {
        /// Where reference points are: grid, in the scene's bounds; objects, in the centre of each object, which they
        /// light alone; camera, where the camera is; auto, objects if another technique adds indirect light, else grid.
        pub reference_points: ReferencePoints = ReferencePoints::Auto => any(),
        /// Reference points of a grid per metre; 0: about 64 in the scene.
        pub density: f32 = 0.0 => in_range(0.0, 1e6).unit("1/m"),
        /// Side of the faces of the small cubes, whose texels are area lights.
        pub size: u32 = 4 => in_range(2.0, 16.0).power_of_two().unit("texels"),
        /// Side of the faces of the cubes that are captured, a power of two.
        pub resolution: u32 = 32 => in_range(16.0, 1024.0).power_of_two().unit("texels"),
        /// Estimate of the lights' solid angles: disc, the tutorial's; oriented, foreshortened by the light's normal;
        /// quad, exact form factors of quadrilaterals.
        pub solid_angle: SolidAngle = SolidAngle::Oriented => any(),
        /// Whether lights are seen from the shaded point; otherwise as from the reference point, as if they were far
        /// away: classical environment mapping, for comparison.
        pub localize: bool = true => any(),
        /// Whether the weights of the lights are divided by their sum.
        pub normalize: bool = true => any(),
        /// Whether lights are tested for being seen: none, or distance, by the distances that reference points know.
        pub visibility: Visibility = Visibility::Distance => any(),
        /// Reference points of a grid that light a point: all eight around it, or one of them, drawn by its weight.
        pub blend: Blend = Blend::All => any(),
        /// Bounces of light beyond the first between what the reference points see.
        pub bounces: u32 = 16 => in_range(0.0, 4096.0),
        /// Whether glossy reflection is added, too, and passed on by the surroundings.
        pub glossy: bool = false => any(),
        /// Whether obscurances, which have to be in use, multiply the light: they darken corners and folds that the area
        /// lights do not resolve.
        pub occlusion: bool = false => any(),
        /// Whether the lit surface of an object with a reference point of its own lights the object's other parts.
        pub own_surface: bool = true => any(),
        /// Faces of cubes that are captured per frame; the others follow in the next frames.
        pub faces_per_frame: u32 = 48 => in_range(1.0, 6144.0),
        /// Objects that are lit by points of their own: names separated by commas, * for any characters; * alone: all,
        /// but only the 32 largest of more.
        pub objects: String = ALL.to_owned() => any(),
    }
}

/// The value of [`Settings::objects`] that names all objects, even none.
pub const ALL: &str = "*";
