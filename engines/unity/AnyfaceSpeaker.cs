// A face in Unity that speaks with an AudioSource. Put it and AnyfaceVoice.cs into Assets, the library into
// Assets/Plugins, and this on the object that has the AudioSource. Its clip needs the load type Decompress On Load.
using System;
using Anyface;
using UnityEngine;

[RequireComponent(typeof(AudioSource))]
public sealed class AnyfaceSpeaker : MonoBehaviour
{
    [Tooltip("What has blend shapes with names of ARKit (jawOpen), or of visemes (viseme_aa)")]
    public SkinnedMeshRenderer face;

    [Tooltip("Bone of the head; none leaves it still")]
    public Transform head;

    [Tooltip("neutral, happy:0.5, sad:0.4,calm:0.3, or auto for what is heard in the voice")]
    public string emotion = "neutral";

    [Tooltip("Whether singing, music and noise move the face too")]
    public bool anySound;

    private AudioSource source;
    private AudioClip heard;
    private Voice voice;
    private Quaternion rest;
    private string complaint;
    // Of each blend shape the weight that moves it: those of ARKit, then the visemes; -1 for others.
    private int[] weights;

    private void Start()
    {
        source = GetComponent<AudioSource>();
        weights = WeightsOf(face.sharedMesh);
        if (head != null)
        {
            rest = head.localRotation;
        }
    }

    private void LateUpdate()
    {
        if (source.clip == null || !source.isPlaying)
        {
            return;
        }
        try
        {
            if (source.clip != heard)
            {
                Hear(source.clip);
            }
            if (voice == null)
            {
                return;
            }
            voice.Feel(emotion);
            Show(voice.At(source.timeSamples / (double)heard.frequency));
        }
        catch (AnyfaceException error)
        {
            // Once, not in every frame.
            if (error.Message != complaint)
            {
                complaint = error.Message;
                Debug.LogError("Anyface: " + complaint, this);
            }
        }
    }

    private void OnDestroy()
    {
        if (voice != null)
        {
            voice.Dispose();
        }
    }

    private void Hear(AudioClip clip)
    {
        OnDestroy();
        heard = clip;
        voice = null;
        var samples = new float[clip.samples * clip.channels];
        if (!clip.GetData(samples, 0))
        {
            throw new AnyfaceException(clip.name + ": expected a clip that is decompressed on load, got none of its samples");
        }
        voice = new Voice(samples, clip.channels, clip.frequency, anySound);
    }

    private void Show(Frame frame)
    {
        for (int shape = 0; shape < weights.Length; shape++)
        {
            int weight = weights[shape];
            if (weight >= 0)
            {
                float share = weight < Voice.ShapeCount
                    ? frame.Shapes[weight]
                    : frame.Visemes[weight - Voice.ShapeCount];
                face.SetBlendShapeWeight(shape, 100f * share);
            }
        }
        if (head != null)
        {
            // Unity's x is the other side, so turns about y and z go the other way round.
            var turn = new Vector3(frame.Head[0], -frame.Head[1], -frame.Head[2]);
            head.localRotation = rest * Quaternion.AngleAxis(turn.magnitude * Mathf.Rad2Deg, turn);
        }
    }

    private static int[] WeightsOf(Mesh mesh)
    {
        var names = new string[mesh.blendShapeCount];
        for (int shape = 0; shape < names.Length; shape++)
        {
            // FBX puts the name of the deformer before it: blendShape1.jawOpen.
            string name = mesh.GetBlendShapeName(shape);
            names[shape] = name.Substring(name.LastIndexOf('.') + 1);
        }
        // A mesh with both kinds of shapes would move its mouth twice: ARKit's go before visemes.
        bool hasShapes = Array.IndexOf(names, "jawOpen") >= 0;
        return Array.ConvertAll(names, name =>
        {
            int weight = Array.IndexOf(hasShapes ? Voice.ShapeNames : Voice.VisemeNames, name);
            return weight < 0 || hasShapes ? weight : weight + Voice.ShapeCount;
        });
    }
}
