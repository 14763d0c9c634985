//! Expressions of emotions, added to motion that speaks neutrally.
//!
//! A table says what each emotion does to the face and to articulation. Added after sampling, an
//! expression has exactly the strength that was asked for: networks trained by squared error show two
//! thirds of it. What lasts through speech (brows, lids, nose, corners) is simply added; what parts or
//! stretches the lips yields where they close, and lips that speech closes stay closed. Strengths follow
//! what is asked with an onset and a slower offset, wander a little at the apex and grow on stressed
//! syllables.

mod apply;
mod causal;
mod dynamics;
mod lips;
mod manner;
mod table;
#[cfg(test)]
mod tests;

pub use causal::CausalExpression;
pub use table::{Expressions, MODEL};

/// Where the emotion of sampled motion comes from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum EmotionOrigin {
    /// The network was trained on emotional motion, and shows what it is asked for.
    #[default]
    Learned,
    /// The network speaks neutrally; its motion needs an expression.
    Added,
}
