// A face in Unreal Engine 5 that speaks with a sound. Put both files into a module of your project, say in its Build.cs where
// anyface.h and the library lie (PublicIncludePaths, PublicAdditionalLibraries), and replace YOURMODULE_API.
#pragma once

#include "CoreMinimal.h"
#include "Components/ActorComponent.h"

#include <anyface.h>

#include <array>
#include <memory>
#include <vector>

#include "AnyfaceSpeaker.generated.h"

class UAudioComponent;
class USkeletalMeshComponent;

/** The face at one instant of a sound. */
struct FAnyfaceFrame {
    /** Weights of ARKit's shapes and behind them of visemes, 0 to 1, in the order of anyface_weight_stream_name(). */
    std::array<float, ANYFACE_LIVE_SHAPE_COUNT + ANYFACE_LIVE_VISEME_COUNT> Weights{};
    /** Rotation vector in radians: x to the face's left, y up, z to the front. */
    std::array<float, 3> Head{};
};

/** A sound file that is heard as far as it is shown. Belongs to one thread at a time. */
class FAnyfaceVoice {
public:
    /** Reads WAV, MP3, FLAC, Ogg and more; Error says why it cannot be done. */
    static std::unique_ptr<FAnyfaceVoice> FromFile(const char *Utf8Path, bool bAnySound, FString &Error);

    /** "happy:0.5", "sad:0.4,calm:0.3", "neutral", or "auto" for what is heard in the voice; from the next frame on. */
    bool Feel(const char *Utf8Emotion, FString &Error);

    /** The face at an instant of the sound, at rest outside of it. */
    FAnyfaceFrame At(double Seconds, FString &Error);

private:
    struct FFree {
        void operator()(AnyfaceWeightStream *Stream) const { anyface_weight_stream_free(Stream); }
        void operator()(AnyfaceRequest *Request) const { anyface_request_free(Request); }
    };
    std::unique_ptr<AnyfaceWeightStream, FFree> Stream;
    std::unique_ptr<AnyfaceRequest, FFree> Request;
    std::vector<float> Samples;
    std::vector<FAnyfaceFrame> Frames;
    size_t Pushed = 0;
    bool bIsOver = false;

    bool HearOn(FString &Error);
};

/** Plays a sound by an audio component and moves the morph targets of a skeletal mesh to it. */
UCLASS(ClassGroup = (Anyface), meta = (BlueprintSpawnableComponent))
class YOURMODULE_API UAnyfaceSpeaker : public UActorComponent {
    GENERATED_BODY()

public:
    UAnyfaceSpeaker();

    /** What has morph targets with names of ARKit (jawOpen), or of visemes (viseme_aa). */
    UPROPERTY(EditAnywhere, BlueprintReadWrite, Category = "Anyface")
    USkeletalMeshComponent *Face = nullptr;

    /** neutral, happy:0.5, sad:0.4,calm:0.3, or auto for what is heard in the voice. */
    UPROPERTY(EditAnywhere, BlueprintReadWrite, Category = "Anyface")
    FString Emotion = TEXT("neutral");

    /** Whether singing, music and noise move the face too. */
    UPROPERTY(EditAnywhere, BlueprintReadWrite, Category = "Anyface")
    bool bAnySound = false;

    /** The turn of the head, for a Modify Bone node of the animation blueprint. */
    UPROPERTY(BlueprintReadOnly, Category = "Anyface")
    FRotator Head = FRotator::ZeroRotator;

    /** Plays Voice, whose sound is that of the file SoundFile, and follows it. Returns whether the file could be read. */
    UFUNCTION(BlueprintCallable, Category = "Anyface")
    bool Speak(UAudioComponent *Voice, const FString &SoundFile);

    virtual void TickComponent(float DeltaTime, ELevelTick TickType,
                               FActorComponentTickFunction *ThisTickFunction) override;

private:
    std::unique_ptr<FAnyfaceVoice> Heard;
    double StartedAt = 0.0;
    FString Complaint;

    void Complain(const FString &Error);
    void Show(const FAnyfaceFrame &Frame);
};
