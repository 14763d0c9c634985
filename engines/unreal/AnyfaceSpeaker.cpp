#include "AnyfaceSpeaker.h"

#include "Components/AudioComponent.h"
#include "Components/SkeletalMeshComponent.h"
#include "Engine/SkeletalMesh.h"
#include "Engine/World.h"

#include <algorithm>

DEFINE_LOG_CATEGORY_STATIC(LogAnyface, Log, All);

namespace {

constexpr double Fps = 25.0;
constexpr size_t SamplesPerFrame = 640;

/** Whether a call succeeded; otherwise Error is what the library says. */
bool Done(AnyfaceStatus Status, AnyfaceError *&Failure, FString &Error) {
    if (Status == ANYFACE_STATUS_OK) {
        return true;
    }
    Error = UTF8_TO_TCHAR(anyface_error_message(Failure));
    anyface_error_free(Failure);
    Failure = nullptr;
    return false;
}

/** The models, loaded once and kept until the program ends. */
AnyfaceEngine *Engine(FString &Error) {
    static AnyfaceEngine *Loaded = nullptr;
    AnyfaceError *Failure = nullptr;
    if (Loaded == nullptr) {
        Done(anyface_engine_new(nullptr, &Loaded, &Failure), Failure, Error);
    }
    return Loaded;
}

} // namespace

std::unique_ptr<FAnyfaceVoice> FAnyfaceVoice::FromFile(const char *Utf8Path, bool bAnySound, FString &Error) {
    AnyfaceError *Failure = nullptr;
    AnyfaceEngine *Models = Engine(Error);
    AnyfaceAudio *Audio = nullptr;
    if (Models == nullptr || !Done(anyface_audio_read(Utf8Path, &Audio, &Failure), Failure, Error)) {
        return nullptr;
    }
    auto Voice = std::make_unique<FAnyfaceVoice>();
    Voice->Samples.resize(anyface_audio_sample_count(Audio));
    const AnyfaceStatus Copied =
        anyface_audio_copy_samples(Audio, Voice->Samples.data(), Voice->Samples.size(), &Failure);
    anyface_audio_free(Audio);
    AnyfaceWeightStream *Stream = nullptr;
    AnyfaceRequest *Request = nullptr;
    if (!Done(Copied, Failure, Error) ||
        !Done(anyface_weight_stream_new(Models, &Stream, &Failure), Failure, Error)) {
        return nullptr;
    }
    Voice->Stream.reset(Stream);
    if (!Done(anyface_request_new(&Request, &Failure), Failure, Error)) {
        return nullptr;
    }
    Voice->Request.reset(Request);
    if (!Done(anyface_request_set_number(Request, "hear_all", bAnySound ? 1.0 : 0.0, &Failure), Failure, Error) ||
        !Done(anyface_weight_stream_obey(Stream, Request, &Failure), Failure, Error)) {
        return nullptr;
    }
    return Voice;
}

bool FAnyfaceVoice::Feel(const char *Utf8Emotion, FString &Error) {
    AnyfaceError *Failure = nullptr;
    return Done(anyface_request_set_text(Request.get(), "emotion", Utf8Emotion, &Failure), Failure, Error) &&
           Done(anyface_weight_stream_obey(Stream.get(), Request.get(), &Failure), Failure, Error);
}

bool FAnyfaceVoice::HearOn(FString &Error) {
    AnyfaceError *Failure = nullptr;
    const size_t Count = std::min(SamplesPerFrame, Samples.size() - Pushed);
    if (!Done(anyface_weight_stream_push(Stream.get(), Samples.data() + Pushed, Count, &Failure), Failure,
              Error)) {
        return false;
    }
    Pushed += Count;
    if (Pushed == Samples.size()) {
        bIsOver = true;
        if (!Done(anyface_weight_stream_finish(Stream.get(), &Failure), Failure, Error)) {
            return false;
        }
    }
    for (;;) {
        FAnyfaceFrame Frame;
        int32_t bIsReady = 0;
        float *Visemes = Frame.Weights.data() + ANYFACE_LIVE_SHAPE_COUNT;
        if (!Done(anyface_weight_stream_pull(Stream.get(), Frame.Weights.data(), Visemes, Frame.Head.data(),
                                             &bIsReady, &Failure),
                  Failure, Error)) {
            return false;
        }
        if (bIsReady == 0) {
            return true;
        }
        Frames.push_back(Frame);
    }
}

FAnyfaceFrame FAnyfaceVoice::At(double Seconds, FString &Error) {
    const double Place = Seconds * Fps;
    const size_t Number = Place > 0.0 ? static_cast<size_t>(Place) : 0;
    while (Frames.size() < Number + 2 && !bIsOver) {
        if (!HearOn(Error)) {
            break;
        }
    }
    if (Place < 0.0 || Number >= Frames.size()) {
        return {};
    }
    FAnyfaceFrame Frame = Frames[Number];
    if (Number + 1 < Frames.size()) {
        const FAnyfaceFrame &Next = Frames[Number + 1];
        const float Share = static_cast<float>(Place - static_cast<double>(Number));
        for (size_t i = 0; i < Frame.Weights.size(); i++) {
            Frame.Weights[i] += Share * (Next.Weights[i] - Frame.Weights[i]);
        }
        for (size_t i = 0; i < Frame.Head.size(); i++) {
            Frame.Head[i] += Share * (Next.Head[i] - Frame.Head[i]);
        }
    }
    return Frame;
}

UAnyfaceSpeaker::UAnyfaceSpeaker() {
    PrimaryComponentTick.bCanEverTick = true;
}

bool UAnyfaceSpeaker::Speak(UAudioComponent *Voice, const FString &SoundFile) {
    FString Error;
    Heard = FAnyfaceVoice::FromFile(TCHAR_TO_UTF8(*SoundFile), bAnySound, Error);
    if (Heard == nullptr) {
        Complain(Error);
        return false;
    }
    StartedAt = GetWorld()->GetAudioTimeSeconds();
    if (Voice != nullptr) {
        Voice->Play();
    }
    return true;
}

void UAnyfaceSpeaker::TickComponent(float DeltaTime, ELevelTick TickType,
                                    FActorComponentTickFunction *ThisTickFunction) {
    Super::TickComponent(DeltaTime, TickType, ThisTickFunction);
    if (Heard == nullptr) {
        return;
    }
    FString Error;
    Heard->Feel(TCHAR_TO_UTF8(*Emotion), Error);
    Show(Heard->At(GetWorld()->GetAudioTimeSeconds() - StartedAt, Error));
    Complain(Error);
}

void UAnyfaceSpeaker::Complain(const FString &Error) {
    // Once, not in every frame.
    if (Error != Complaint) {
        Complaint = Error;
        if (!Error.IsEmpty()) {
            UE_LOG(LogAnyface, Error, TEXT("%s"), *Error);
        }
    }
}

void UAnyfaceSpeaker::Show(const FAnyfaceFrame &Frame) {
    // Unreal's head looks along x, its right is y, up is z; pitch lifts the nose, yaw and roll go to the right.
    const auto Degrees = [](float Radians) { return Radians * 57.29578; };
    Head = FRotator(-Degrees(Frame.Head[0]), -Degrees(Frame.Head[1]), Degrees(Frame.Head[2]));
    if (Face == nullptr) {
        return;
    }
    // A mesh with both kinds of shapes would move its mouth twice: ARKit's go before visemes.
    USkeletalMesh *Mesh = Face->GetSkeletalMeshAsset();
    const bool bHasShapes = Mesh != nullptr && Mesh->FindMorphTarget(FName("jawOpen")) != nullptr;
    const size_t First = bHasShapes ? 0 : ANYFACE_LIVE_SHAPE_COUNT;
    const size_t Last = bHasShapes ? ANYFACE_LIVE_SHAPE_COUNT : Frame.Weights.size();
    for (size_t i = First; i < Last; i++) {
        Face->SetMorphTarget(FName(anyface_weight_stream_name(i)), Frame.Weights[i]);
    }
}
