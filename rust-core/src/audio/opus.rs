//! Adds an Opus decoder to symphonia, which reads the containers but lacks the codec.

use opus_pure::OpusDecoder as Codec;
use symphonia::core::{
    audio::{
        AsGenericAudioBufferRef, Audio, AudioBuffer, AudioMut, AudioSpec, GenericAudioBufferRef,
        layouts::{CHANNEL_LAYOUT_MONO, CHANNEL_LAYOUT_STEREO},
    },
    codecs::{
        CodecInfo,
        audio::{
            AudioCodecParameters, AudioDecoder, AudioDecoderOptions, FinalizeResult,
            well_known::CODEC_ID_OPUS,
        },
        registry::{RegisterableAudioDecoder, SupportedAudioCodec},
    },
    errors::{Error, Result, decode_error, unsupported_error},
    packet::PacketRef,
};

/// Opus is decoded at this rate, whatever the rate of the recording.
const RATE_HZ: u32 = 48_000;
/// Frames in the longest packet, 120 ms (RFC 6716, 3.2.5).
const LONGEST_PACKET: usize = 5_760;

/// Decodes one stream of one or two channels.
pub(super) struct OpusDecoder {
    parameters: AudioCodecParameters,
    codec: Codec,
    /// One packet, `[S, C]`.
    interleaved: Vec<f32>,
    decoded: AudioBuffer<f32>,
}

impl OpusDecoder {
    fn new(parameters: &AudioCodecParameters) -> Result<Self> {
        let channels = parameters.channels.as_ref().map_or(1, |c| c.count());
        let layout = match channels {
            1 => CHANNEL_LAYOUT_MONO,
            2 => CHANNEL_LAYOUT_STEREO,
            _ => return unsupported_error("opus: expected one or two channels, got more"),
        };
        let Ok(codec) = Codec::new(RATE_HZ as i32, channels) else {
            return unsupported_error("opus: no decoder for these channels");
        };
        let spec = AudioSpec::new(RATE_HZ, layout);
        Ok(OpusDecoder {
            parameters: parameters.clone(),
            codec,
            interleaved: vec![0.0; LONGEST_PACKET * channels],
            decoded: AudioBuffer::new(spec, LONGEST_PACKET),
        })
    }
}

/// Frames before the sound at 48 kHz, as the identification header states them (RFC 7845, 5.1).
///
/// The header in MP4 has version 0 and is big-endian; the others are little-endian.
pub(super) fn pre_skip(parameters: &AudioCodecParameters) -> Option<u16> {
    match parameters.extra_data.as_deref() {
        Some([b'O', b'p', b'u', b's', _, _, _, _, version, _, one, two, ..]) => match version {
            0 => Some(u16::from_be_bytes([*one, *two])),
            _ => Some(u16::from_le_bytes([*one, *two])),
        },
        _ => None,
    }
}

impl AudioDecoder for OpusDecoder {
    fn reset(&mut self) {
        // A reset fails for no decoder that could be created.
        _ = self.codec.reset_state();
    }

    fn codec_info(&self) -> &CodecInfo {
        &Self::supported_codecs()[0].info
    }

    fn codec_params(&self) -> &AudioCodecParameters {
        &self.parameters
    }

    fn decode_ref(&mut self, packet: &PacketRef<'_>) -> Result<GenericAudioBufferRef<'_>> {
        // The codec would take an empty packet for a lost one and fill it with a guess.
        if packet.data.is_empty() {
            return decode_error("opus: empty packet");
        }
        let frames = self
            .codec
            .decode(packet.data, LONGEST_PACKET, &mut self.interleaved)
            .map_err(|_| Error::DecodeError("opus: invalid packet"))?;
        let samples = frames * self.decoded.spec().channels().count();
        self.decoded.clear();
        self.decoded.render_uninit(Some(frames));
        self.decoded
            .copy_from_slice_interleaved(&&self.interleaved[..samples]);
        // The intake drops the frames before the sound, whatever the container.
        let behind = usize::try_from(packet.trim_end.get()).unwrap_or(usize::MAX);
        self.decoded.trim(0, behind);
        Ok(self.decoded.as_generic_audio_buffer_ref())
    }

    fn finalize(&mut self) -> FinalizeResult {
        FinalizeResult::default()
    }

    fn last_decoded(&self) -> GenericAudioBufferRef<'_> {
        self.decoded.as_generic_audio_buffer_ref()
    }
}

impl RegisterableAudioDecoder for OpusDecoder {
    fn try_registry_new(
        parameters: &AudioCodecParameters,
        _: &AudioDecoderOptions,
    ) -> Result<Box<dyn AudioDecoder>> {
        Ok(Box::new(OpusDecoder::new(parameters)?))
    }

    fn supported_codecs() -> &'static [SupportedAudioCodec] {
        const INFO: CodecInfo = CodecInfo {
            short_name: "opus",
            long_name: "Opus",
            profiles: &[],
        };
        &[SupportedAudioCodec {
            id: CODEC_ID_OPUS,
            info: INFO,
        }]
    }
}
