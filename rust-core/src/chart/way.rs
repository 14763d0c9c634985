//! Finds the cheapest sequence of mouths in which each one stays for a while.

/// Chooses the mouth of each pose. `costs` `[P][M]`: the cost of each mouth in each pose. `least`
/// `[M]`: the fewest poses for which each mouth stays. `change`: the cost of a change. If there are
/// fewer poses in all than a mouth needs, it may stay for just those.
pub fn cheapest(costs: &[Vec<f64>], least: &[usize], change: f64) -> Vec<usize> {
    let (poses, mouths) = (costs.len(), least.len());
    if poses == 0 {
        return Vec::new();
    }
    let least: Vec<usize> = least.iter().map(|&n| n.clamp(1, poses)).collect();
    // The cost of each mouth over all poses before this one.
    let mut sums = vec![vec![0.0; mouths]; poses + 1];
    for pose in 0..poses {
        for mouth in 0..mouths {
            sums[pose + 1][mouth] = sums[pose][mouth] + costs[pose][mouth];
        }
    }
    // The lowest cost up to each pose if it shows this mouth, and where the mouth's segment begins.
    let mut best = vec![vec![f64::INFINITY; mouths]; poses + 1];
    let mut begins = vec![vec![0; mouths]; poses + 1];
    for end in 1..=poses {
        for mouth in 0..mouths {
            if best[end - 1][mouth].is_finite() && end > 1 {
                best[end][mouth] = best[end - 1][mouth] + costs[end - 1][mouth];
                begins[end][mouth] = begins[end - 1][mouth];
            }
            let Some(first) = end.checked_sub(least[mouth]) else {
                continue;
            };
            let before = match first {
                0 => 0.0,
                _ => {
                    change
                        + cheapest_of(&best[first], Some(mouth))
                            .map_or(f64::INFINITY, |m| best[first][m])
                }
            };
            let total = before + sums[end][mouth] - sums[first][mouth];
            if total < best[end][mouth] {
                (best[end][mouth], begins[end][mouth]) = (total, first);
            }
        }
    }
    let mut chosen = vec![0; poses];
    let (mut end, mut without) = (poses, None);
    while end > 0 {
        let mouth = cheapest_of(&best[end], without).unwrap_or_default();
        let first = begins[end][mouth];
        chosen[first..end].fill(mouth);
        (end, without) = (first, Some(mouth));
    }
    chosen
}

fn cheapest_of(costs: &[f64], without: Option<usize>) -> Option<usize> {
    let others = (0..costs.len()).filter(|&mouth| Some(mouth) != without);
    others.min_by(|&a, &b| costs[a].total_cmp(&costs[b]))
}
