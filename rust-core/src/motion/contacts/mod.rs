//! What lips do where the sound says so: they touch in p, b, m, f, v and come forward in u, o, w.
//!
//! Whatever is trained by squared error blurs a contact, which lasts a frame or two; what hears it
//! ([`LipContacts`]) does not.

mod approach;
mod lips;
mod rounding;
mod teeth;

use super::{FaceModes, LandmarkClip};
use crate::{Result, speech::LipContacts};

pub use approach::{Parting, approach, restore_contacts};
pub use lips::{TOUCHING_M, narrow, opening};
pub use rounding::{forward, shortfall};
pub use teeth::{AT_TEETH_M, LIP, distance, excess};

impl LandmarkClip {
    /// Rounds the lips for u, o, w, brings the lower lip to the upper teeth for f and v, and the lips together for p,
    /// b, m.
    ///
    /// Frames far from a contact stay as the network says, which moves as recorded lips do.
    ///
    /// # Errors
    /// `Weights` for modes without the jaw.
    pub fn make_contacts(&mut self, contacts: &LipContacts, modes: &FaceModes) -> Result<()> {
        rounding::round_lips(self, &contacts.rounding, modes)?;
        teeth::reach_teeth(self, &contacts.at_teeth);
        lips::close_lips(self, &contacts.together, modes)
    }
}
