//! The scene as a game: somebody walks in it, uses what moves and throws balls. It knows neither windows nor the GPU: what
//! happens comes out as edits of the scene.

pub mod ball;
pub mod drive;
pub mod player;
pub mod solid;
#[cfg(test)]
mod tests;

use std::ops::Range;

use glam::{Quat, Vec2, Vec3, Vec3Swizzles};
use gpugi_scene::animation::Rig;
use gpugi_scene::bvh::BvhError;
use gpugi_scene::{Document, Edit, Scene};

use ball::Ball;
use drive::Drive;
use player::{EYE, Player};
use solid::Solid;

/// Walking and running (m/s, for a person).
const SPEED: [f32; 2] = [2.2, 5.0];
/// How far somebody reaches (m).
const REACH: f32 = 3.0;
/// Angle around the middle of the picture within which something to use is looked for, too (rad).
const AROUND: f32 = 0.12;
/// Speed of a thrown ball: forward and upward (m/s), and how far from the eye it leaves the hand (m).
const THROW: [f32; 2] = [7.0, 1.5];
const HAND: f32 = 0.6;
/// Diagonals of scenes that are taken to be in metres, for people (m).
const FOR_PEOPLE: [f32; 2] = [2.0, 200.0];

/// What somebody wants to do in a frame.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Intent {
    /// To the right and forward, at most 1 long.
    pub way: Vec2,
    /// Faster.
    pub runs: bool,
    /// Once.
    pub jumps: bool,
}

/// What somebody sees: the eye (world space (m)), and unit vectors forward and, in the horizontal plane, to the right.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sight {
    /// World space (m).
    pub eye: Vec3,
    /// Unit vector.
    pub forward: Vec3,
    /// Unit vector, horizontal.
    pub right: Vec3,
}

/// A game in a scene.
#[derive(Debug)]
pub struct Game {
    solid: Solid,
    /// Who walks, if anybody does.
    pub player: Option<Player>,
    /// Length of a person's metre in the scene (m).
    unit: f32,
    /// The balls' instances. Those that were not thrown yet are not in `balls`.
    balls_at: Range<usize>,
    balls: Vec<Ball>,
    /// m.
    ball_radius: f32,
    /// Number of throws.
    throws: usize,
    drives: Vec<Drive>,
    /// The scene's rig without the nodes in use.
    rig: Option<Rig>,
}

/// The height of an eye that suits a scene (m). A scene whose core is 2 to 200 m large is for people, and has 1.7 m.
/// Others have a power of ten of that, by which the core is 2 to 20 times as large as a person's metre.
pub fn eye_height(scene: &Scene) -> f32 {
    let size = scene.core().diagonal();
    let [least, most] = FOR_PEOPLE;
    if (least..=most).contains(&size) || !(size > 0.0 && size.is_finite()) {
        return EYE;
    }
    EYE * 10.0_f32.powf((size / least).log10().floor())
}

impl Game {
    /// A game in the scene as it is. `eye` is the height of an eye above the ground (m).
    ///
    /// # Errors
    /// [`BvhError`].
    pub fn new(document: &Document, eye: f32) -> Result<Self, BvhError> {
        Ok(Self {
            solid: Solid::new(document, 0..0)?,
            player: None,
            unit: eye / EYE,
            balls_at: 0..0,
            balls: Vec::new(),
            ball_radius: ball::RADIUS * eye / EYE,
            throws: 0,
            drives: Vec::new(),
            rig: None,
        })
    }

    /// The same game in another document of the same scene, in which the instances `balls` are balls.
    ///
    /// # Errors
    /// [`BvhError`].
    pub fn renew(&mut self, document: &Document, balls: Range<usize>) -> Result<(), BvhError> {
        self.solid = Solid::new(document, balls.clone())?;
        let scene = document.scene();
        if let Some(ball) = scene
            .instances
            .get(balls.start)
            .filter(|_| !balls.is_empty())
        {
            let bounds = scene.meshes[ball.mesh].bounds();
            self.ball_radius = (bounds.max.y - bounds.min.y) / 2.0;
        }
        self.balls_at = balls;
        Ok(())
    }

    /// The height of an eye above the ground (m).
    pub fn eye_height(&self) -> f32 {
        EYE * self.unit
    }

    /// Instances of the balls.
    pub fn balls(&self) -> Range<usize> {
        self.balls_at.clone()
    }

    /// Radius of a ball (m).
    pub fn ball_radius(&self) -> f32 {
        self.ball_radius
    }

    /// Somebody begins to walk where `sight` is, with an eye at `height` (m). Returns whether there is ground.
    ///
    /// # Errors
    /// [`BvhError`].
    pub fn walk(
        &mut self,
        document: &Document,
        sight: Sight,
        height: f32,
    ) -> Result<bool, BvhError> {
        self.solid.follow(document)?;
        self.unit = height / EYE;
        let looks = sight.forward * document.scene().bounds().diagonal().max(self.unit);
        self.player = Player::new(&self.solid, sight.eye, looks, self.unit);
        Ok(self.player.is_some())
    }

    /// The rig that poses the scene.
    pub fn rig<'a>(&'a self, scene: &'a Scene) -> Option<&'a Rig> {
        self.rig.as_ref().or(scene.rig.as_ref())
    }

    /// Uses what is in the middle of the picture, or close to it, or what the player stands on: it goes to its other end.
    /// `seconds`: what the clock says. Returns whether there is something to use.
    pub fn operate(&mut self, scene: &Scene, sight: Sight, seconds: f32) -> bool {
        let Some(rig) = &scene.rig else { return false };
        let up = sight.right.cross(sight.forward);
        let turned = |angle: f32| {
            let aside = Quat::from_axis_angle(sight.forward, angle) * up;
            (sight.forward + aside * AROUND.tan()).normalize()
        };
        let ring = (0..8).map(|eighth| turned(eighth as f32 * std::f32::consts::FRAC_PI_4));
        let rays = std::iter::once(sight.forward).chain(ring);
        let touched = rays.filter_map(|ray| self.solid.cast(sight.eye, ray * (REACH * self.unit)));
        let touched = touched.map(|touch| touch.instance);
        let below = self.player.as_ref().and_then(Player::stands_on);
        let mut usable = touched.chain(below).filter_map(|instance| {
            let node = scene.instances[instance].node?;
            drive::moving(rig, node)
        });
        let Some(node) = usable.next() else {
            return false;
        };
        if let Some(drive) = self.drives.iter_mut().find(|drive| drive.node == node) {
            drive.turn();
            return true;
        }
        let drive = Drive::new(rig, node, seconds);
        self.drives.extend(drive.clone());
        drive.is_some()
    }

    /// Moves what is in use. Returns whether the scene is to be posed anew.
    pub fn drive(&mut self, scene: &Scene, seconds: f32) -> bool {
        let Some(rig) = &scene.rig else { return false };
        let mut has_moved = false;
        for drive in &mut self.drives {
            if drive.advance(rig, seconds) {
                let held = self.rig.get_or_insert_with(|| rig.clone());
                held.hold(drive.node, drive.place(rig));
                has_moved = true;
            }
        }
        has_moved
    }

    /// Where a ball leaves the hand (world space (m)).
    pub fn hand(&self, sight: Sight) -> Vec3 {
        let reach = sight.forward * (HAND * self.unit);
        match self.solid.cast(sight.eye, reach * 1.5) {
            // Not into a wall.
            Some(touch) => sight.eye + (touch.point - sight.eye) * 0.3,
            None => sight.eye + reach,
        }
    }

    /// Throws a ball: one that nobody has thrown yet, or else the one that was thrown first.
    pub fn throw(&mut self, sight: Sight) {
        let count = self.balls_at.len();
        if count == 0 {
            return;
        }
        let [forward, upward] = THROW.map(|speed| speed * self.unit);
        let velocity = sight.forward * forward + Vec3::Y * upward;
        let ball = Ball::new(self.hand(sight), velocity, self.ball_radius);
        match self.balls.get_mut(self.throws % count) {
            Some(before) => *before = ball,
            None => self.balls.push(ball),
        }
        self.throws += 1;
    }

    /// Lives on for `seconds` in the scene as it is now. Returns the edits that move the balls.
    ///
    /// # Errors
    /// [`BvhError`].
    pub fn advance(
        &mut self,
        document: &Document,
        sight: Sight,
        intent: Intent,
        seconds: f32,
    ) -> Result<Vec<Edit>, BvhError> {
        if self.solid.follow(document)? {
            self.balls.iter_mut().for_each(Ball::wake);
        }
        if let Some(player) = &mut self.player {
            let forward = Vec3::Y.cross(sight.right);
            let way = sight.right * intent.way.x + forward * intent.way.y;
            let speed = SPEED[usize::from(intent.runs)] * self.unit;
            let velocity = way.xz().clamp_length_max(1.0) * speed;
            player.advance(&self.solid, velocity, intent.jumps, seconds);
            let body = player.body();
            for ball in &mut self.balls {
                kick(ball, body, velocity);
            }
        }
        let mut has_moved: Vec<bool> = (self.balls.iter_mut())
            .map(|ball| ball.advance(&self.solid, self.unit, seconds))
            .collect();
        for second in 1..self.balls.len() {
            let (before, after) = self.balls.split_at_mut(second);
            for (first, ball) in before.iter_mut().enumerate() {
                if ball::collide(ball, &mut after[0]) {
                    (has_moved[first], has_moved[second]) = (true, true);
                }
            }
        }
        let moved = self.balls.iter().zip(has_moved).enumerate();
        let moved = moved.filter(|(_, (ball, has_moved))| *has_moved && ball.center.is_finite());
        let edits = moved.map(|(number, (ball, _))| Edit::Instance {
            index: self.balls_at.start + number,
            world_from_mesh: ball.place(),
        });
        Ok(edits.collect())
    }
}

/// Pushes a ball out of a body (feet, radius, height) that goes along the ground at `velocity` (m/s).
fn kick(ball: &mut Ball, (feet, radius, height): (Vec3, f32, f32), velocity: Vec2) {
    let axis = feet.with_y(ball.center.y.clamp(feet.y, feet.y + height));
    let away = ball.center - axis;
    let depth = radius + ball.radius - away.length();
    let Some(normal) = away.with_y(0.0).try_normalize().filter(|_| depth > 0.0) else {
        return;
    };
    ball.center += normal * depth;
    let velocity = Vec3::new(velocity.x, 0.0, velocity.y);
    let toward = (velocity - ball.velocity).dot(normal);
    ball.velocity += normal * toward.max(0.0);
    ball.wake();
}
