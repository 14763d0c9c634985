// Stands for Unity, as far as AnyfaceSpeaker.cs uses it, and plays a clip: Host.exe SAMPLES RATE EMOTION, where SAMPLES are
// 16-bit and mono. A line a frame: weights of three shapes in percent, and the turn of the head.
using System;
using System.Collections.Generic;
using System.Globalization;
using System.IO;
using System.Reflection;

namespace UnityEngine
{
    public sealed class TooltipAttribute : Attribute { public TooltipAttribute(string text) { } }
    public sealed class RequireComponent : Attribute { public RequireComponent(Type type) { } }

    public class Component
    {
        internal Dictionary<Type, object> beside = new Dictionary<Type, object>();
        public T GetComponent<T>() { return (T)beside[typeof(T)]; }
    }
    public class MonoBehaviour : Component { }

    public sealed class AudioClip
    {
        internal float[] all;
        public string name = "voice";
        public int samples, channels, frequency;
        public bool GetData(float[] data, int first) { Array.Copy(all, first, data, 0, data.Length); return true; }
    }
    public sealed class AudioSource { public AudioClip clip; public bool isPlaying; public int timeSamples; }

    public sealed class Mesh
    {
        internal string[] names;
        public int blendShapeCount { get { return names.Length; } }
        public string GetBlendShapeName(int place) { return names[place]; }
    }
    public sealed class SkinnedMeshRenderer
    {
        internal float[] weights = new float[3];
        public Mesh sharedMesh;
        public void SetBlendShapeWeight(int place, float percent) { weights[place] = percent; }
    }
    public sealed class Transform { public Quaternion localRotation; }
    public struct Vector3
    {
        public float x, y, z;
        public Vector3(float x, float y, float z) { this.x = x; this.y = y; this.z = z; }
        public float magnitude { get { return (float)Math.Sqrt(x * x + y * y + z * z); } }
    }
    public struct Quaternion
    {
        internal float degrees;
        internal Vector3 axis;
        public static Quaternion AngleAxis(float degrees, Vector3 axis)
        {
            return new Quaternion { degrees = degrees, axis = axis };
        }
        public static Quaternion operator *(Quaternion rest, Quaternion turn) { return turn; }
    }
    public static class Mathf { public const float Rad2Deg = 57.29578f; }
    public static class Debug
    {
        public static void LogError(string text, Component about) { Console.Error.WriteLine(text); }
    }
}

public static class Host
{
    public static void Main(string[] words)
    {
        byte[] bytes = File.ReadAllBytes(words[0]);
        var all = new float[bytes.Length / 2];
        for (int i = 0; i < all.Length; i++)
        {
            all[i] = BitConverter.ToInt16(bytes, 2 * i) / 32768f;
        }
        int rate = int.Parse(words[1]);
        var clip = new UnityEngine.AudioClip { all = all, samples = all.Length, channels = 1, frequency = rate };
        var source = new UnityEngine.AudioSource { clip = clip, isPlaying = true };
        var mesh = new UnityEngine.Mesh { names = new[] { "head.jawOpen", "other", "head.mouthSmileLeft" } };
        var face = new UnityEngine.SkinnedMeshRenderer { sharedMesh = mesh };
        var head = new UnityEngine.Transform();
        var speaker = new AnyfaceSpeaker { face = face, head = head, emotion = words[2], anySound = true };
        speaker.beside[typeof(UnityEngine.AudioSource)] = source;
        Call(speaker, "Start");
        for (int frame = 0; frame * rate / 25 < all.Length; frame++)
        {
            source.timeSamples = frame * rate / 25;
            Call(speaker, "LateUpdate");
            Console.WriteLine(string.Format(
                CultureInfo.InvariantCulture, "{0:R} {1:R} {2:R} {3:R} {4:R} {5:R}", face.weights[0], face.weights[1],
                face.weights[2], head.localRotation.axis.x, head.localRotation.axis.y, head.localRotation.axis.z));
        }
        Call(speaker, "OnDestroy");
    }

    // Unity calls these by name.
    private static void Call(object speaker, string name)
    {
        speaker.GetType().GetMethod(name, BindingFlags.Instance | BindingFlags.NonPublic).Invoke(speaker, null);
    }
}
