//! Shuts the lids of an eye that was cut free, and measures how much of the eye stays visible.

use glam::Vec3;
use ndarray::{Array3, ArrayView2};

use super::space::EyeSpace;
use crate::{
    Error, Result,
    face::{Face, eyes::Opening},
    mesh::{
        FrontView, PartRole,
        ibug::{EYES, LANDMARKS},
    },
};

/// How far the lids of the canonical face travel until they are shut, metres.
const WAY_M: f32 = 0.0079;
/// The upper lid's share of this distance.
const UPPER_SHARE: f32 = 0.9;
/// Largest visible area of the ball of a shut eye, as a share of the visible area of the open ball.
const MAX_IN_SIGHT: f64 = 0.05;
/// Largest visible area of skin that turned inside out, as a share of the same area.
const MAX_TURNED: f64 = 0.02;

/// Kinds of the cells of a picture.
const SKIN: u8 = 1;
const BALL: u8 = 2;
const TURNED: u8 = 3;

/// What a trial blink of one eye showed, as shares of the visible area of the open ball.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct EyeTrial {
    /// Visible area of the ball.
    pub in_sight: f64,
    /// Visible area of skin that turned inside out.
    pub turned: f64,
}

impl EyeTrial {
    /// Canonical motion `[1, 68, 3]`, metres, that shuts both eyes.
    pub(crate) fn blink() -> Array3<f32> {
        let mut moved = Array3::zeros((1, LANDMARKS, 3));
        for (upper, lower) in EYES.iter().flat_map(|eye| eye.pairs) {
            moved[[0, upper, 1]] = -UPPER_SHARE * WAY_M;
            moved[[0, lower, 1]] = (1.0 - UPPER_SHARE) * WAY_M;
        }
        moved
    }

    /// Measures one eye of a face whose vertices are displaced by `moved` `[V, 3]`, mesh units and
    /// axes.
    pub(crate) fn of(face: &Face, opening: &Opening, moved: ArrayView2<'_, f32>) -> EyeTrial {
        let space = EyeSpace {
            frame: opening.frame,
            to_canonical: face.to_canonical,
        };
        let rest = |v: u32| space.local(face.mesh.positions[v as usize]);
        let shut = |v: u32| {
            let p = face.mesh.positions[v as usize];
            space.local(std::array::from_fn(|i| p[i] + moved[[v as usize, i]]))
        };
        let picture = |at: &dyn Fn(u32) -> Vec3| {
            let reach = opening.width;
            let mut view = FrontView::new([-reach; 2], [reach; 2], reach / 120.0);
            for t in &face.mesh.triangles {
                let before = t.map(rest);
                if before.iter().any(|p| p.length() > 3.0 * opening.width) {
                    continue;
                }
                let now = t.map(at);
                let across = |[a, b, c]: [Vec3; 3]| (b - a).cross(c - a).z;
                let kind = if face.parts.is(t[0] as usize, PartRole::Gaze) {
                    BALL
                } else if face.parts.is(t[0] as usize, PartRole::Skin) {
                    if across(before) * across(now) < 0.0 {
                        TURNED
                    } else {
                        SKIN
                    }
                } else {
                    continue;
                };
                view.draw(now.map(Into::into), kind);
            }
            let cells = (0..view.columns()).flat_map(|c| (0..view.rows()).map(move |r| (c, r)));
            cells.fold([0usize; 4], |mut counts, (column, row)| {
                counts[usize::from(view.kind(column, row))] += 1;
                counts
            })
        };
        let whole = picture(&rest)[usize::from(BALL)].max(1) as f64;
        let areas = picture(&shut);
        EyeTrial {
            in_sight: areas[usize::from(BALL)] as f64 / whole,
            turned: areas[usize::from(TURNED)] as f64 / whole,
        }
    }

    /// Refuses an eye that stays open or whose skin turns inside out.
    ///
    /// # Errors
    /// `Mesh`, which says what is wrong and what to do.
    pub(crate) fn check(&self) -> Result<()> {
        let percent = |share: f64| format!("{:.0} %", 100.0 * share);
        let got = if self.in_sight > MAX_IN_SIGHT {
            format!("{} of an eye in sight", percent(self.in_sight))
        } else if self.turned > MAX_TURNED {
            format!(
                "skin turned over, {} of an eye in size",
                percent(self.turned)
            )
        } else {
            return Ok(());
        };
        Err(Error::Mesh(format!(
            "open eyes: expected lids that shut over the whole eye, got {got}; the mesh is as it was. Put the landmarks of \
             the eyes (36 to 47) where lids and eyes meet and try again, or cut the eyes by hand"
        )))
    }
}
