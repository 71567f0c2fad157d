//! The scene on show as a game: somebody walks in it, uses what moves and throws balls.

use std::ops::Range;

use glam::Vec3;
use gpugi::LightingError;
use gpugi::gpu::GpuError;

use super::Session;
use crate::game::player::Player;
use crate::game::{self, Game, Sight};

impl Session {
    /// Somebody walks from where the camera stands, with an eye at this height above the ground (m), or at one that suits
    /// the scene.
    ///
    /// # Errors
    /// Why nobody can; the camera then flies on.
    pub fn walk(&mut self, eye_height: Option<f32>) -> Result<(), String> {
        let sight = self.sight();
        let before = self.game.as_ref().map(Game::eye_height);
        let height = eye_height.or(before);
        let height = height.unwrap_or_else(|| game::eye_height(self.loaded.scene()));
        self.begin_game(height)?;
        let Some(game) = &mut self.game else {
            return Ok(());
        };
        let begun = game.walk(&self.loaded.document, sight, height);
        if !begun.map_err(|error| error.to_string())? {
            return Err(
                "there is no ground to walk on, neither below the camera nor below what it sees"
                    .into(),
            );
        }
        self.follow_player(None);
        Ok(())
    }

    /// The camera flies again. Balls go on.
    pub fn fly(&mut self) {
        if let Some(game) = &mut self.game {
            game.player = None;
        }
    }

    /// Who walks has gone, with the camera, to another place: walks there.
    pub(super) fn walk_on(&mut self) {
        if self.eye_height().is_some() && self.walk(None).is_err() {
            self.fly();
        }
    }

    /// The height of the eye above the ground while somebody walks (m).
    pub fn eye_height(&self) -> Option<f32> {
        let game = self.game.as_ref()?;
        game.player.is_some().then(|| game.eye_height())
    }

    /// Uses what is in the middle of the picture ([`Game::operate`]). Returns whether there is something to use.
    pub fn operate(&mut self) -> bool {
        let (sight, seconds) = (self.sight(), self.clock.seconds);
        let game = self.game.as_mut();
        game.is_some_and(|game| game.operate(self.loaded.scene(), sight, seconds))
    }

    /// Throws a ball, if the scene has balls, and says whether it has.
    pub fn throw(&mut self) -> bool {
        let sight = self.sight();
        match self.game.as_mut().filter(|game| !game.balls().is_empty()) {
            Some(game) => {
                game.throw(sight);
                true
            }
            None => false,
        }
    }

    /// Where a ball is to be added to the scene, and its radius (world space (m)).
    ///
    /// # Errors
    /// Why there can be none.
    pub fn hand(&mut self) -> Result<(Vec3, f32), String> {
        self.begin_game(game::eye_height(self.loaded.scene()))?;
        let sight = self.sight();
        let hand = |game: &Game| (game.hand(sight), game.ball_radius());
        self.game
            .as_ref()
            .map(hand)
            .ok_or_else(|| "there is no game".into())
    }

    /// Instances of the balls in the scene on show.
    pub fn balls(&self) -> Range<usize> {
        self.game.as_ref().map_or(0..0, Game::balls)
    }

    /// Takes these instances as balls.
    pub fn take_balls(&mut self, balls: Range<usize>) {
        self.renew_game(balls);
    }

    fn begin_game(&mut self, eye_height: f32) -> Result<(), String> {
        if self.game.is_none() {
            let game = Game::new(&self.loaded.document, eye_height);
            self.game = Some(game.map_err(|error| error.to_string())?);
        }
        Ok(())
    }

    /// The game goes on in the scene that was loaded in place of the same one.
    pub(super) fn renew_game(&mut self, balls: Range<usize>) {
        let document = &self.loaded.document;
        let game = self.game.take();
        self.game = game.and_then(|mut game| game.renew(document, balls).ok().map(|()| game));
    }

    /// Moves what is in use. Returns whether the scene is to be posed anew.
    pub(super) fn drive(&mut self, seconds: f32) -> bool {
        let scene = self.loaded.scene();
        let game = self.game.as_mut();
        game.is_some_and(|game| game.drive(scene, seconds))
    }

    /// Who walks and what was thrown move on for `seconds`.
    pub(super) fn live(&mut self, seconds: f32) -> Result<(), LightingError> {
        let (sight, intent) = (self.sight(), self.intent);
        self.intent.jumps = false;
        let Some(game) = &mut self.game else {
            return Ok(());
        };
        let before = game.player.as_ref().map(Player::eye);
        let edits = match game.advance(&self.loaded.document, sight, intent, seconds) {
            Ok(edits) => edits,
            Err(error) => {
                self.game = None;
                let what = error.to_string();
                return Err(LightingError::Gpu(GpuError::Input { what }));
            }
        };
        self.follow_player(before);
        if !edits.is_empty() {
            // Not in words: a scene that is opened anew has no balls.
            self.loaded.edit(&edits)?;
            self.is_edited = true;
        }
        Ok(())
    }

    /// The camera goes where the player's eye is, if that is not where it was.
    fn follow_player(&mut self, before: Option<Vec3>) {
        let player = self.game.as_ref().and_then(|game| game.player.as_ref());
        let eye = player.map(Player::eye);
        if let Some(eye) = eye.filter(|_| eye != before) {
            self.camera.go_to(eye);
        }
    }

    /// What somebody at the camera sees.
    fn sight(&self) -> Sight {
        let (eye, forward, right) = self.camera.sight();
        Sight {
            eye,
            forward,
            right,
        }
    }
}
