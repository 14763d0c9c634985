//! Slopes of the canonical field with respect to the point and the head's code, by the chain rule.
//!
//! [`IdentitySlopes::at`] explains the method.

use super::{Identity, IdentityField, is_mirrored, network_of};
use crate::{
    head::network::{
        encode,
        slopes::{NetworkSlopes, TemplateSlopes, Trace, through_encoding},
    },
    nn::elementwise::softmax,
};

/// The field's matrices, packed for the backward pass.
pub(in crate::head) struct IdentitySlopes {
    locals: Vec<NetworkSlopes>,
    template: TemplateSlopes,
}

/// The distance at points, in units of the field, and its slopes.
pub(in crate::head) struct FieldSlopes {
    /// `[Q]`.
    pub distance: Vec<f32>,
    /// Slope of the distance with respect to each point, `[Q]`.
    pub place: Vec<[f32; 3]>,
    /// Slope of the distance with respect to the code, `[Q, Z]`.
    pub code: Vec<f32>,
}

/// One network's contribution to the points where its weight is above 0.
struct Part {
    number: usize,
    side: f32,
    rows: Vec<usize>,
    trace: Trace,
}

impl IdentitySlopes {
    pub fn new(identity: &Identity) -> Self {
        IdentitySlopes {
            locals: identity.locals.iter().map(NetworkSlopes::new).collect(),
            template: TemplateSlopes::new(&identity.template),
        }
    }

    /// The distance at points `[Q]` of one head, and its slopes with respect to each point and to
    /// the code. Runs on the calling thread.
    ///
    /// The field is `T(x + Σ_n w_n(x, a) D_n(x, a_n, z))`. A blend of small networks at anchors `a`
    /// moves the point, and `T` gives the distance of the moved point from the mean head (see
    /// [`super`]). This function applies the chain rule backwards, in one pass for all numbers of
    /// the code.
    ///
    /// 1. Forward: compute the blend weights. Then run each network at only the points where its
    ///    weight is not 0, and keep a trace of its layers.
    /// 2. The mean head `T` gives the distance and its slope with respect to the moved point. This
    ///    slope is the `pull` on everything before it.
    /// 3. The point itself gets the whole pull. Each network gets its weight times the pull and
    ///    passes it to its code and its input ([`IdentitySlopes::through`]). The input is the point
    ///    relative to the anchor, so the anchor gets the same slope with the opposite sign.
    /// 4. The slope with respect to a blend weight is the network's offset along the pull. It goes
    ///    back through the division by the sum, the threshold and the softmax to points and anchors
    ///    ([`Blend::through`]).
    /// 5. Anchors are landmarks, and landmarks are linear in the global part of the code. So the
    ///    anchors' slopes become slopes with respect to that part.
    ///
    /// The cost is a small multiple of evaluating the field at the points, whatever the length Z of
    /// the code. Finite differences would cost Z evaluations. Memory is Q times the widths of all
    /// layers, so the fit passes a hundred points at a time.
    ///
    /// Not obvious: the left anchor of a pair uses the right anchor's network with x mirrored. The
    /// x components of its offset and of its slope change sign, and so do the numbers of the global
    /// code that `mirror` marks. The threshold makes a network's weight exactly 0 away from its
    /// anchor. The distance has a kink where the weight becomes 0, and the slope is the one on the
    /// point's side of it. The background network has no anchor, and its frame has a scale of its
    /// own.
    pub fn at(&self, field: &IdentityField<'_>, points: &[[f32; 3]]) -> FieldSlopes {
        let (config, identity, columns) = (field.config, field.identity, field.locals.len());
        let blend = Blend::of(field, points);
        let (places, parts) = on_mean(field, points, &blend.weights);
        let encoded = encode(&places, config.octaves);
        let (distance, of_encoded) = self.template.at(&identity.template, &encoded, points.len());
        let pull = through_encoding(&encoded, &of_encoded, config.octaves);
        let mut out = FieldSlopes {
            distance,
            place: pull.clone(),
            code: vec![0.0; points.len() * config.identity_code()],
        };
        let anchors = field.anchors.len();
        let mut of_anchors = vec![[0.0; 3]; points.len() * anchors];
        let mut of_weights = vec![0.0; points.len() * columns];
        for part in &parts {
            self.through(
                part,
                field,
                &pull,
                &blend.weights,
                &mut of_weights,
                &mut of_anchors,
                &mut out,
            );
        }
        blend.through(field, points, &of_weights, &mut of_anchors, &mut out.place);
        through_anchors(field, &of_anchors, &mut out.code);
        out
    }

    /// Adds one network's part to the slopes. Writes the slope with respect to the network's blend
    /// weight to `of_weights`.
    #[expect(clippy::too_many_arguments)]
    fn through(
        &self,
        part: &Part,
        field: &IdentityField<'_>,
        pull: &[[f32; 3]],
        weights: &[f32],
        of_weights: &mut [f32],
        of_anchors: &mut [[f32; 3]],
        out: &mut FieldSlopes,
    ) {
        let (config, columns) = (field.config, field.locals.len());
        let (number, side) = (part.number, part.side);
        let mut pulls = Vec::with_capacity(3 * part.rows.len());
        for (&row, offset) in part.rows.iter().zip(part.trace.out.as_chunks::<3>().0) {
            let [x, y, z] = pull[row];
            let way = [side * x, y, z];
            of_weights[row * columns + number] = (0..3).map(|a| way[a] * offset[a]).sum();
            pulls.extend(way.map(|g| weights[row * columns + number] * g));
        }
        let network = &self.locals[network_of(config, number)];
        let slopes = network.slopes(&field.locals[number], &part.trace, &pulls);
        let (global, codes) = (config.global_code, config.identity_code());
        let anchors = field.anchors.len();
        let scale = if number < anchors {
            config.sigma.recip()
        } else {
            config.background.sqrt().recip()
        };
        let of_network = slopes.code.chunks_exact(global + config.local_code);
        let rows = part.rows.iter().zip(slopes.inputs.as_chunks::<3>().0);
        for ((&row, [x, y, z]), of_code) in rows.zip(of_network) {
            let by = [side * x, *y, *z].map(|d| scale * d);
            for axis in 0..3 {
                out.place[row][axis] += by[axis];
                if number < anchors {
                    of_anchors[row * anchors + number][axis] -= by[axis];
                }
            }
            let code = &mut out.code[row * codes..][..codes];
            let (shared, local) = code.split_at_mut(global);
            for (k, to) in shared.iter_mut().enumerate() {
                let sign = if side < 0.0 {
                    field.identity.mirror[k]
                } else {
                    1.0
                };
                *to += sign * of_code[k];
            }
            let local = &mut local[number * config.local_code..][..config.local_code];
            local
                .iter_mut()
                .zip(&of_code[global..])
                .for_each(|(to, x)| *to += x);
        }
    }
}

/// Moves points `[Q]` onto the mean head with blend `weights` `[Q, A + 1]`. Returns their places
/// there and each network's part.
fn on_mean(
    field: &IdentityField<'_>,
    points: &[[f32; 3]],
    weights: &[f32],
) -> (Vec<[f32; 3]>, Vec<Part>) {
    let columns = field.locals.len();
    let mut places = points.to_vec();
    let mut parts = Vec::with_capacity(columns);
    for (number, local) in field.locals.iter().enumerate() {
        let rows: Vec<usize> = (0..points.len())
            .filter(|row| weights[row * columns + number] > 0.0)
            .collect();
        if rows.is_empty() {
            continue;
        }
        let side = if is_mirrored(field.config, number) {
            -1.0
        } else {
            1.0
        };
        let trace = local.trace(&field.framed(number, points, &rows, side), rows.len());
        for (row, [x, y, z]) in rows.iter().zip(trace.out.as_chunks::<3>().0) {
            let weight = weights[row * columns + number];
            for (to, x) in places[*row].iter_mut().zip([side * x, *y, *z]) {
                *to += weight * x;
            }
        }
        parts.push(Part {
            number,
            side,
            rows,
            trace,
        });
    }
    (places, parts)
}

/// Adds the effect of slopes with respect to the anchors, `[Q, A]`, to those with respect to the
/// code, `[Q, Z]`.
///
/// Anchors are landmarks, which are linear in the global part of the code.
fn through_anchors(field: &IdentityField<'_>, of_anchors: &[[f32; 3]], of_code: &mut [f32]) {
    let config = field.config;
    let landmark_weight = field.identity.landmarks.weight();
    let marks = config.landmark_numbers();
    for (code, anchors) in of_code
        .chunks_exact_mut(config.identity_code())
        .zip(of_anchors.chunks_exact(field.anchors.len()))
    {
        for (mark, slope) in marks.iter().zip(anchors) {
            for (k, to) in code[..config.global_code].iter_mut().enumerate() {
                *to += (0..3)
                    .map(|a| landmark_weight[(k, 3 * mark + a)] * slope[a])
                    .sum::<f32>();
            }
        }
    }
}

/// Blend weights of the anchors and the background, and the values that their slopes need;
/// `[Q, A + 1]`.
struct Blend {
    shares: Vec<f32>,
    weights: Vec<f32>,
    /// The sum by which the weights of a point were divided, `[Q]`.
    sums: Vec<f32>,
}

impl Blend {
    fn of(field: &IdentityField<'_>, points: &[[f32; 3]]) -> Blend {
        let (columns, least) = (field.locals.len(), field.config.least_weight);
        let mut shares = field.closeness(points);
        shares.chunks_exact_mut(columns).for_each(softmax);
        let mut weights: Vec<f32> = shares.iter().map(|p| (p - least).max(0.0)).collect();
        let rows = weights.chunks_exact_mut(columns);
        let sums = rows
            .map(|row| {
                let sum: f32 = row.iter().sum();
                row.iter_mut().for_each(|w| *w /= sum);
                sum
            })
            .collect();
        Blend {
            shares,
            weights,
            sums,
        }
    }

    /// Adds the effect of slopes with respect to the weights to those of the anchors and the
    /// points.
    fn through(
        &self,
        field: &IdentityField<'_>,
        points: &[[f32; 3]],
        of_weights: &[f32],
        of_anchors: &mut [[f32; 3]],
        of_points: &mut [[f32; 3]],
    ) {
        let (columns, anchors) = (field.locals.len(), field.anchors.len());
        let twice = field.config.sigma.powi(-2);
        for (row, x) in points.iter().enumerate() {
            let range = row * columns..(row + 1) * columns;
            let (shares, weights) = (&self.shares[range.clone()], &self.weights[range.clone()]);
            let of_weights = &of_weights[range];
            let mean: f32 = weights.iter().zip(of_weights).map(|(w, d)| w * d).sum();
            let of_share = |n: usize| {
                if weights[n] > 0.0 {
                    (of_weights[n] - mean) / self.sums[row]
                } else {
                    0.0
                }
            };
            let all: f32 = (0..columns).map(|n| shares[n] * of_share(n)).sum();
            for (n, anchor) in field.anchors.iter().enumerate() {
                let by = twice * shares[n] * (of_share(n) - all);
                for axis in 0..3 {
                    let way = by * (x[axis] - anchor[axis]);
                    of_anchors[row * anchors + n][axis] += way;
                    of_points[row][axis] -= way;
                }
            }
        }
    }
}
