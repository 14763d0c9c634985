// Plays a sound file (host SOUND SECONDS EMOTION). Prints a line for each frame: the weights of two shapes, and the
// turn of the head.
#include "AnyfaceSpeaker.h"

#include <cstdlib>

int main(int, char **words) {
    UAnyfaceSpeaker speaker;
    USkeletalMeshComponent face;
    UAudioComponent voice;
    speaker.Face = &face;
    speaker.bAnySound = true;
    speaker.Emotion = words[3];
    if (speaker.Speak(&voice, "no such file") || voice.bPlays) {
        return 1;
    }
    speaker.World.Now = 7.0;
    if (!speaker.Speak(&voice, words[1]) || !voice.bPlays || !speaker.PrimaryComponentTick.bCanEverTick) {
        return 2;
    }
    for (int frame = 0; frame < 25 * std::atof(words[2]); frame++) {
        speaker.World.Now = 7.0 + frame / 25.0 + 1e-9;
        speaker.TickComponent(0.04f, LEVELTICK_All, nullptr);
        std::printf("%.9g %.9g %.9g %.9g %.9g\n", face.Weights["jawOpen"], face.Weights["mouthSmileLeft"], speaker.Head.Pitch,
                    speaker.Head.Yaw, speaker.Head.Roll);
    }
    return 0;
}
