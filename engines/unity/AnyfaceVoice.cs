// The C interface of Anyface for .NET: a sound in, weights of blend shapes out. Plain C#, without Unity.
// The library stands beside the program or in Assets/Plugins: libanyface.so, anyface.dll or libanyface.dylib.
using System;
using System.Collections.Generic;
using System.Runtime.InteropServices;
using System.Text;

namespace Anyface
{
    /// <summary>A call that failed, with the library's own words.</summary>
    public sealed class AnyfaceException : Exception
    {
        public AnyfaceException(string message) : base(message) { }
    }

    /// <summary>The face at one instant of a sound.</summary>
    public sealed class Frame
    {
        /// <summary>Weights of the shapes in <see cref="Voice.ShapeNames"/>, 0 to 1.</summary>
        public readonly float[] Shapes = new float[Voice.ShapeCount];
        /// <summary>Weights of the visemes in <see cref="Voice.VisemeNames"/>, 0 to 1.</summary>
        public readonly float[] Visemes = new float[Voice.VisemeCount];
        /// <summary>Rotation vector of the head in radians: x to its left, y up, z to the front.</summary>
        public readonly float[] Head = new float[3];
    }

    /// <summary>A sound that is heard as far as it is shown. Belongs to one thread at a time.</summary>
    public sealed class Voice : IDisposable
    {
        public const int ShapeCount = 52;
        public const int VisemeCount = 15;
        /// <summary>Frames a second.</summary>
        public const double Fps = 25.0;
        /// <summary>The emotion that is heard in the voice.</summary>
        public const string Heard = "auto";

        /// <summary>ARKit's names, such as jawOpen.</summary>
        public static readonly string[] ShapeNames = Names(0, ShapeCount);
        /// <summary>Oculus' names, such as viseme_aa.</summary>
        public static readonly string[] VisemeNames = Names(ShapeCount, VisemeCount);

        private const int Samples = 640;
        private static readonly object EngineLock = new object();
        private static IntPtr engine;

        private readonly float[] sound;
        private readonly List<Frame> frames = new List<Frame>();
        private IntPtr stream;
        private IntPtr request;
        private int pushed;
        private bool isOver;
        private string emotion = "";

        /// <param name="samples">Interleaved, nominally -1 to 1.</param>
        /// <param name="channels">Samples of one instant.</param>
        /// <param name="rate">Instants a second, in hertz.</param>
        /// <param name="anySound">Whether music and noise move the face too.</param>
        public Voice(float[] samples, int channels, int rate, bool anySound = false)
        {
            IntPtr error;
            sound = At16Kilohertz(samples, channels, rate);
            Check(Native.anyface_weight_stream_new(Engine(), out stream, out error), error);
            Check(Native.anyface_request_new(out request, out error), error);
            if (anySound)
            {
                Check(Native.anyface_request_set_number(request, Utf8("hear_all"), 1.0, out error), error);
                Check(Native.anyface_weight_stream_obey(stream, request, out error), error);
            }
        }

        /// <summary>The face at an instant of the sound in seconds, at rest outside of it.</summary>
        public Frame At(double seconds)
        {
            double place = seconds * Fps;
            int number = Math.Max(0, (int)Math.Floor(place));
            while (frames.Count < number + 2 && !isOver)
            {
                HearOn();
            }
            if (place < 0.0 || number >= frames.Count)
            {
                return new Frame();
            }
            Frame one = frames[number];
            return number + 1 < frames.Count
                ? Between(one, frames[number + 1], (float)(place - number))
                : one;
        }

        /// <summary>What the face feels from the next frame on: "happy:0.5", "sad:0.3,calm:0.2", "neutral", or
        /// <see cref="Heard"/>.</summary>
        public void Feel(string text)
        {
            if (text == emotion)
            {
                return;
            }
            IntPtr error;
            Check(Native.anyface_request_set_text(request, Utf8("emotion"), Utf8(text), out error), error);
            Check(Native.anyface_weight_stream_obey(stream, request, out error), error);
            emotion = text;
        }

        public void Dispose()
        {
            Free();
            GC.SuppressFinalize(this);
        }

        ~Voice()
        {
            Free();
        }

        private void Free()
        {
            Native.anyface_weight_stream_free(stream);
            Native.anyface_request_free(request);
            stream = request = IntPtr.Zero;
        }

        private void HearOn()
        {
            IntPtr error;
            var block = new float[Math.Min(Samples, sound.Length - pushed)];
            Array.Copy(sound, pushed, block, 0, block.Length);
            pushed += block.Length;
            var count = (UIntPtr)(uint)block.Length;
            Check(Native.anyface_weight_stream_push(stream, block, count, out error), error);
            if (pushed == sound.Length)
            {
                Check(Native.anyface_weight_stream_finish(stream, out error), error);
                isOver = true;
            }
            for (;;)
            {
                var frame = new Frame();
                int isReady;
                Check(
                    Native.anyface_weight_stream_pull(
                        stream, frame.Shapes, frame.Visemes, frame.Head, out isReady, out error),
                    error);
                if (isReady == 0)
                {
                    return;
                }
                frames.Add(frame);
            }
        }

        private static Frame Between(Frame one, Frame other, float share)
        {
            var frame = new Frame();
            Mix(one.Shapes, other.Shapes, share, frame.Shapes);
            Mix(one.Visemes, other.Visemes, share, frame.Visemes);
            Mix(one.Head, other.Head, share, frame.Head);
            return frame;
        }

        private static void Mix(float[] one, float[] other, float share, float[] mixed)
        {
            for (int i = 0; i < mixed.Length; i++)
            {
                mixed[i] = one[i] + share * (other[i] - one[i]);
            }
        }

        private static IntPtr Engine()
        {
            lock (EngineLock)
            {
                if (engine == IntPtr.Zero)
                {
                    IntPtr error;
                    Check(Native.anyface_engine_new(IntPtr.Zero, out engine, out error), error);
                }
                return engine;
            }
        }

        private static float[] At16Kilohertz(float[] samples, int channels, int rate)
        {
            IntPtr audio, error;
            var count = (UIntPtr)(uint)(samples.Length / Math.Max(1, channels));
            Check(
                Native.anyface_audio_new(samples, count, (uint)channels, (uint)rate, out audio, out error),
                error);
            try
            {
                UIntPtr length = Native.anyface_audio_sample_count(audio);
                var mono = new float[(int)length.ToUInt32()];
                Check(Native.anyface_audio_copy_samples(audio, mono, length, out error), error);
                return mono;
            }
            finally
            {
                Native.anyface_audio_free(audio);
            }
        }

        private static string[] Names(int first, int count)
        {
            var names = new string[count];
            for (int i = 0; i < count; i++)
            {
                names[i] = Text(Native.anyface_weight_stream_name((UIntPtr)(uint)(first + i)));
            }
            return names;
        }

        private static void Check(int status, IntPtr error)
        {
            if (status == 0)
            {
                return;
            }
            string message = Text(Native.anyface_error_message(error));
            Native.anyface_error_free(error);
            throw new AnyfaceException(message);
        }

        private static byte[] Utf8(string text)
        {
            return Encoding.UTF8.GetBytes(text + "\0");
        }

        private static string Text(IntPtr utf8)
        {
            var bytes = new List<byte>();
            for (int i = 0; utf8 != IntPtr.Zero && Marshal.ReadByte(utf8, i) != 0; i++)
            {
                bytes.Add(Marshal.ReadByte(utf8, i));
            }
            return Encoding.UTF8.GetString(bytes.ToArray());
        }
    }

    /// <summary>include/anyface.h, as far as it is used here.</summary>
    internal static class Native
    {
        private const string Library = "anyface";

        [DllImport(Library)] internal static extern int anyface_engine_new(IntPtr request, out IntPtr engine, out IntPtr error);
        [DllImport(Library)] internal static extern int anyface_audio_new(float[] samples, UIntPtr frames, uint channels, uint rate, out IntPtr audio, out IntPtr error);
        [DllImport(Library)] internal static extern UIntPtr anyface_audio_sample_count(IntPtr audio);
        [DllImport(Library)] internal static extern int anyface_audio_copy_samples(IntPtr audio, [Out] float[] samples, UIntPtr count, out IntPtr error);
        [DllImport(Library)] internal static extern void anyface_audio_free(IntPtr audio);
        [DllImport(Library)] internal static extern IntPtr anyface_error_message(IntPtr error);
        [DllImport(Library)] internal static extern void anyface_error_free(IntPtr error);
        [DllImport(Library)] internal static extern int anyface_request_new(out IntPtr request, out IntPtr error);
        [DllImport(Library)] internal static extern int anyface_request_set_text(IntPtr request, byte[] name, byte[] text, out IntPtr error);
        [DllImport(Library)] internal static extern int anyface_request_set_number(IntPtr request, byte[] name, double number, out IntPtr error);
        [DllImport(Library)] internal static extern void anyface_request_free(IntPtr request);
        [DllImport(Library)] internal static extern int anyface_weight_stream_new(IntPtr engine, out IntPtr stream, out IntPtr error);
        [DllImport(Library)] internal static extern IntPtr anyface_weight_stream_name(UIntPtr index);
        [DllImport(Library)] internal static extern int anyface_weight_stream_push(IntPtr stream, float[] samples, UIntPtr count, out IntPtr error);
        [DllImport(Library)] internal static extern int anyface_weight_stream_pull(IntPtr stream, [Out] float[] shapes, [Out] float[] visemes, [Out] float[] head, out int isReady, out IntPtr error);
        [DllImport(Library)] internal static extern int anyface_weight_stream_finish(IntPtr stream, out IntPtr error);
        [DllImport(Library)] internal static extern int anyface_weight_stream_obey(IntPtr stream, IntPtr request, out IntPtr error);
        [DllImport(Library)] internal static extern void anyface_weight_stream_free(IntPtr stream);
    }
}
