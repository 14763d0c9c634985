//! Makes the lips touch in p, b, m, f, v and gives the mouth the shapes of u, o, ʃ and θ, where the
//! sound says so.
//!
//! A contact lasts a frame or two. A network trained on squared error blurs it; the network that
//! detects contacts ([`LipContacts`]) does not.

mod approach;
mod lips;
mod shapes;
mod teeth;
mod width;

use super::{FaceModes, LandmarkClip};
use crate::{Result, speech::LipContacts};

pub use approach::{Parting, approach, restore_contacts};
pub use lips::{TOUCHING_M, narrow, opening};
pub use shapes::{chin, forward, gap, missing, width};
pub use teeth::{AT_TEETH_M, LIP, distance, excess};
pub use width::WidthGain;

impl LandmarkClip {
    /// Shapes the mouth ([`crate::speech::LIP_SHAPES`]), then makes it [touch](Self::touch).
    ///
    /// Frames far from a contact keep the network's motion, which resembles that of recorded lips.
    ///
    /// # Errors
    /// `Weights` for modes without the jaw.
    pub fn make_contacts(&mut self, contacts: &LipContacts, modes: &FaceModes) -> Result<()> {
        self.take_shapes(contacts, modes)?;
        self.touch(contacts, modes)
    }

    /// Gives the mouth the shapes of [`crate::speech::LIP_SHAPES`].
    ///
    /// # Errors
    /// `Weights` for modes without the jaw.
    pub(crate) fn take_shapes(&mut self, contacts: &LipContacts, modes: &FaceModes) -> Result<()> {
        shapes::take_shapes(self, &contacts.shapes, modes)
    }

    /// Brings the lower lip to the upper teeth for f and v, and the lips together for p, b, m.
    ///
    /// # Errors
    /// `Weights` for modes without the jaw.
    pub(crate) fn touch(&mut self, contacts: &LipContacts, modes: &FaceModes) -> Result<()> {
        teeth::reach_teeth(self, &contacts.at_teeth);
        lips::close_lips(self, &contacts.together, modes)
    }
}
