//! Mixes channels to mono: their mean, or the loudest channel where they cancel each other.
//!
//! A balanced microphone on a stereo jack has the same voice upside down on its second channel.
//! The mean of the two is silence.

/// Until a sample is louder than this, nothing is heard, and the mean will do.
const QUIET: f32 = 1e-3;
/// How long the channels are compared, from the first sample that is heard on, seconds.
const COMPARED_S: f32 = 1.0;
/// The channels cancel each other where their mean has less than this share of the power of the
/// loudest channel.
const CANCELLED: f64 = 0.01;

/// Mixes frames to mono. Where the pieces of a sound begin and end changes nothing.
pub(super) struct Mixdown {
    channels: usize,
    /// Frames that are compared.
    compared: usize,
    mix: Mix,
}

enum Mix {
    /// Nothing was heard so far.
    Silence,
    /// The samples since the first one that was heard, interleaved.
    Comparing(Vec<f32>),
    Mean,
    Channel(usize),
}

impl Mixdown {
    pub(super) fn new(channels: usize, rate_hz: u32) -> Mixdown {
        let mix = if channels == 1 {
            Mix::Channel(0)
        } else {
            Mix::Silence
        };
        Mixdown {
            channels,
            compared: (COMPARED_S * rate_hz as f32) as usize,
            mix,
        }
    }

    /// Takes a frame of one sample a channel. The samples that are ready are added to `mono`.
    pub(super) fn push(&mut self, frame: &[f32], mono: &mut Vec<f32>) {
        if matches!(self.mix, Mix::Silence) && frame.iter().any(|x| x.abs() > QUIET) {
            self.mix = Mix::Comparing(Vec::new());
        }
        match &mut self.mix {
            Mix::Comparing(samples) => {
                samples.extend_from_slice(frame);
                if samples.len() >= self.compared * self.channels {
                    self.decide(mono);
                }
            }
            Mix::Channel(channel) => mono.push(frame[*channel]),
            Mix::Silence | Mix::Mean => mono.push(mean(frame)),
        }
    }

    /// Adds the samples that still wait.
    pub(super) fn finish(&mut self, mono: &mut Vec<f32>) {
        self.decide(mono);
    }

    fn decide(&mut self, mono: &mut Vec<f32>) {
        let Mix::Comparing(samples) = &mut self.mix else {
            return;
        };
        let samples = std::mem::take(samples);
        let frames = || samples.chunks_exact(self.channels);
        let power = |of: &dyn Fn(&[f32]) -> f32| -> f64 {
            frames().map(|frame| f64::from(of(frame)).powi(2)).sum()
        };
        let channels = (0..self.channels).map(|c| (power(&|frame| frame[c]), c));
        let (loudest, channel) = channels.fold((0.0, 0), |a, b| if b.0 > a.0 { b } else { a });
        if power(&mean) < CANCELLED * loudest {
            self.mix = Mix::Channel(channel);
            mono.extend(frames().map(|frame| frame[channel]));
        } else {
            self.mix = Mix::Mean;
            mono.extend(frames().map(mean));
        }
    }
}

fn mean(frame: &[f32]) -> f32 {
    let share = 1.0 / frame.len() as f32;
    frame.iter().map(|x| x * share).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    const RATE_HZ: u32 = 8_000;

    /// Half a second of silence, then two of a tone, in two channels.
    fn stereo(right: impl Fn(f32) -> f32) -> Vec<[f32; 2]> {
        let tone = |t: usize| {
            if t < 4_000 {
                0.0
            } else {
                (0.1 * t as f32).sin()
            }
        };
        (0..20_000).map(|t| [tone(t), right(tone(t))]).collect()
    }

    fn mixed(frames: &[[f32; 2]]) -> Vec<f32> {
        let (mut mixdown, mut mono) = (Mixdown::new(2, RATE_HZ), Vec::new());
        frames
            .iter()
            .for_each(|frame| mixdown.push(frame, &mut mono));
        mixdown.finish(&mut mono);
        mono
    }

    #[test]
    fn channels_that_cancel_each_other_are_not_silence() {
        for frames in [
            stereo(|x| -x),
            stereo(|x| -0.95 * x),
            stereo(|x| -1.1 * x)[..6_000].to_vec(),
        ] {
            let mono = mixed(&frames);
            assert_eq!(mono.len(), frames.len());
            let loudest = frames.iter().zip(&mono).all(|([a, b], m)| m == a || m == b);
            assert!(loudest);
            assert!(mono.iter().any(|x| x.abs() > 0.9));
        }
    }

    #[test]
    fn all_other_channels_are_mixed() {
        for frames in [
            stereo(|x| x),
            stereo(|x| 0.3 * x),
            stereo(|_| 0.0),
            stereo(|x| -0.5 * x),
        ] {
            let expected: Vec<f32> = frames.iter().map(|frame| mean(frame)).collect();
            assert_eq!(mixed(&frames), expected);
        }
    }
}
