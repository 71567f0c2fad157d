//! Gamepads. On Linux, the kernel's joystick devices are read as files; a page asks its browser. Other systems have none
//! here.

use std::sync::{Arc, Mutex, PoisonError};

use glam::Vec2;

/// A stick that is nearer to its middle rests.
const DEAD: f32 = 0.15;

/// What a gamepad says.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Pad {
    /// Sticks: to the right and up, at most 1 long.
    pub left: Vec2,
    /// The same.
    pub right: Vec2,
    /// Whether its buttons are down: that to jump (the lower one: A, or the cross), to throw (the right one: B, or the
    /// circle), and to use (the third: X, or the triangle).
    pub buttons: [bool; 3],
}

impl Pad {
    /// Without the tremble of sticks around their middle.
    fn steady(mut self) -> Self {
        for stick in [&mut self.left, &mut self.right] {
            let beyond = (stick.length() - DEAD) / (1.0 - DEAD);
            *stick = stick.normalize_or_zero() * beyond.clamp(0.0, 1.0);
        }
        self
    }

    /// Which buttons have gone down since `before`.
    pub fn pressed(&self, before: &Self) -> [bool; 3] {
        [0, 1, 2].map(|button| self.buttons[button] && !before.buttons[button])
    }
}

/// The first gamepad that there is.
#[derive(Debug, Default)]
pub struct Gamepad(Arc<Mutex<Option<Pad>>>);

impl Gamepad {
    /// Begins to listen. `wake` is called, on another thread, when a gamepad says something new.
    pub fn new(wake: impl Fn() + Send + 'static) -> Self {
        let pad = Self::default();
        #[cfg(target_os = "linux")]
        {
            let heard = Arc::downgrade(&pad.0);
            std::thread::spawn(move || linux::listen(&heard, &wake));
        }
        #[cfg(not(target_os = "linux"))]
        let _ = wake;
        pad
    }

    /// What it says now; `None` if there is none.
    pub fn state(&self) -> Option<Pad> {
        let mut pad = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        #[cfg(target_arch = "wasm32")]
        {
            *pad = of_browser(&crate::browser::gamepad());
        }
        pad.as_mut().map(|pad| pad.steady())
    }
}

/// The pad that `browser::gamepad` tells of: four axes, downward where they are vertical, and three buttons.
#[cfg(any(target_arch = "wasm32", test))]
fn of_browser(values: &[f32]) -> Option<Pad> {
    let &[x, y, turn, tilt, jump, throw, operate] = values else {
        return None;
    };
    Some(Pad {
        left: Vec2::new(x, -y),
        right: Vec2::new(turn, -tilt),
        buttons: [jump, throw, operate].map(|value| value > 0.5),
    })
}

/// The kernel's joystick devices (Documentation/input/joydev/joystick-api.rst): eight bytes per event. They need neither a
/// library nor, for who sits at the machine, rights.
#[cfg(target_os = "linux")]
mod linux {
    use std::fs::File;
    use std::io::Read;
    use std::sync::{Mutex, PoisonError, Weak};
    use std::time::Duration;

    use super::Pad;

    /// Time after which a device is looked for again.
    const PAUSE: Duration = Duration::from_secs(2);
    /// Devices that are tried.
    const DEVICES: u32 = 8;

    /// Listens to the first device that can be opened, until nobody wants to know.
    pub fn listen(heard: &Weak<Mutex<Option<Pad>>>, wake: &dyn Fn()) {
        loop {
            let mut devices = (0..DEVICES).map(|number| format!("/dev/input/js{number}"));
            if let Some(mut device) = devices.find_map(|device| File::open(device).ok()) {
                follow(&mut device, heard, wake);
            }
            if heard.strong_count() == 0 {
                return;
            }
            std::thread::sleep(PAUSE);
        }
    }

    /// Follows a device until it is gone.
    pub fn follow(device: &mut impl Read, heard: &Weak<Mutex<Option<Pad>>>, wake: &dyn Fn()) {
        let (mut pad, mut event) = (Pad::default(), [0; 8]);
        let tell = |pad| {
            let shared = heard.upgrade()?;
            *shared.lock().unwrap_or_else(PoisonError::into_inner) = pad;
            wake();
            Some(())
        };
        while device.read_exact(&mut event).is_ok() {
            take(&mut pad, event);
            if tell(Some(pad)).is_none() {
                return;
            }
        }
        tell(None);
    }

    /// Takes an event: time (4 bytes), value (2), type, number. The numbers are those of the kernel's layout for gamepads
    /// (Documentation/input/gamepad.rst), in which triggers are axes 2 and 5.
    fn take(pad: &mut Pad, [.., low, high, kind, number]: [u8; 8]) {
        let value = i16::from_le_bytes([low, high]);
        let part = f32::from(value) / f32::from(i16::MAX);
        // The first events, which tell where all is, have this bit, too.
        const INITIAL: u8 = 0x80;
        match (kind & !INITIAL, number) {
            (1, number @ 0..3) => pad.buttons[usize::from(number)] = value != 0,
            (2, 0) => pad.left.x = part,
            (2, 1) => pad.left.y = -part,
            (2, 3) => pad.right.x = part,
            (2, 4) => pad.right.y = -part,
            _ => {}
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_pad_is_what_the_browser_says() {
        assert_eq!(of_browser(&[]), None);
        let pad = of_browser(&[0.5, -1.0, 0.0, 0.1, 0.0, 1.0, 0.0]).unwrap();
        assert_eq!(pad.left, Vec2::new(0.5, 1.0));
        assert_eq!(pad.buttons, [false, true, false]);
        assert_eq!(pad.pressed(&Pad::default()), [false, true, false]);
        assert_eq!(pad.pressed(&pad), [false; 3]);
        let steady = pad.steady();
        assert_eq!(steady.right, Vec2::ZERO);
        assert!(steady.left.length() <= 1.0 && steady.left.y > 0.8);
    }

    #[cfg(target_os = "linux")]
    #[test]
    fn events_of_a_joystick_move_a_pad() {
        let event = |value: i16, kind: u8, number: u8| {
            let [low, high] = value.to_le_bytes();
            [1, 2, 3, 4, low, high, kind, number]
        };
        // Its right stick up, as it is found; the third button; and a device that goes in the middle of an event.
        let said = [
            event(-i16::MAX, 0x82, 4),
            event(1, 1, 2),
            event(9, 2, 77),
            event(9, 7, 7),
        ];
        let said = [said.as_flattened(), &[1, 2, 3]].concat();
        let pad = Gamepad::default();
        let heard = std::cell::RefCell::new(Vec::new());
        let wake = || heard.borrow_mut().push(pad.state());
        linux::follow(&mut &said[..], &Arc::downgrade(&pad.0), &wake);
        let heard = heard.into_inner();
        let last = heard[3].unwrap();
        assert_eq!(last.left, Vec2::ZERO);
        assert!(last.right.distance(Vec2::Y) < 1e-6);
        assert_eq!(last.buttons, [false, false, true]);
        assert_eq!(heard.len(), 5);
        assert_eq!(heard[4], None);
    }
}
