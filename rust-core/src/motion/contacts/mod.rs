//! Makes the lips touch in p, b, m, f, v and come forward in u, o, w, where the sound says so.
//!
//! A contact lasts a frame or two. A network trained on squared error blurs it; the network that
//! detects contacts ([`LipContacts`]) does not.

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
    /// Rounds the lips for u, o, w, brings the lower lip to the upper teeth for f and v, and brings the
    /// lips together for p, b, m.
    ///
    /// Frames far from a contact keep the network's motion, which resembles that of recorded lips.
    ///
    /// # Errors
    /// `Weights` for modes without the jaw.
    pub fn make_contacts(&mut self, contacts: &LipContacts, modes: &FaceModes) -> Result<()> {
        rounding::round_lips(self, &contacts.rounding, modes)?;
        teeth::reach_teeth(self, &contacts.at_teeth);
        lips::close_lips(self, &contacts.together, modes)
    }
}
