//! Lips that touch where the sound says p, b, m, f or v.
//!
//! Whatever is trained by squared error blurs a contact, which lasts a frame or two; what hears it
//! ([`LipContacts`]) does not.

mod approach;
mod lips;
mod teeth;

use super::{FaceModes, LandmarkClip};
use crate::{Result, speech::LipContacts};

pub use approach::{Parting, approach, restore_contacts};
pub use lips::{TOUCHING_M, narrow, opening};
pub use teeth::{AT_TEETH_M, LIP, distance, excess};

impl LandmarkClip {
    /// Brings the lower lip to the upper teeth for f and v, and the lips together for p, b, m.
    ///
    /// Frames far from a contact stay as the network says, which moves as recorded lips do.
    ///
    /// # Errors
    /// `Weights` for modes without the jaw.
    pub fn make_contacts(&mut self, contacts: &LipContacts, modes: &FaceModes) -> Result<()> {
        teeth::reach_teeth(self, &contacts.at_teeth);
        lips::close_lips(self, &contacts.together, modes)
    }
}
