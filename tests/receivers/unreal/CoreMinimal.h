// Stands for Unreal Engine, as far as engines/unreal uses it.
#pragma once

#include <cstdint>
#include <cstdio>
#include <map>
#include <string>

using int32 = int32_t;

#define TEXT(text) text
#define UTF8_TO_TCHAR(text) text
#define TCHAR_TO_UTF8(text) text
#define UCLASS(...)
#define UPROPERTY(...)
#define UFUNCTION(...)
#define GENERATED_BODY() using Super = UActorComponent;
#define YOURMODULE_API
#define DEFINE_LOG_CATEGORY_STATIC(...)
#define UE_LOG(category, level, format, ...) std::fprintf(stderr, format "\n", __VA_ARGS__)

class FString : public std::string {
public:
    using std::string::string;
    const char *operator*() const { return c_str(); }
    bool IsEmpty() const { return empty(); }
};
using FName = std::string;

struct FRotator {
    double Pitch = 0, Yaw = 0, Roll = 0;
    FRotator() = default;
    FRotator(double InPitch, double InYaw, double InRoll) : Pitch(InPitch), Yaw(InYaw), Roll(InRoll) {}
    static const FRotator ZeroRotator;
};
inline const FRotator FRotator::ZeroRotator{};

class UWorld {
public:
    double Now = 0.0;
    double GetAudioTimeSeconds() const { return Now; }
};

class UMorphTarget {};

class USkeletalMesh {
public:
    UMorphTarget Jaw;
    UMorphTarget *FindMorphTarget(FName Name) { return Name == "jawOpen" ? &Jaw : nullptr; }
};

class USkeletalMeshComponent {
public:
    USkeletalMesh Mesh;
    std::map<FName, float> Weights;
    USkeletalMesh *GetSkeletalMeshAsset() { return &Mesh; }
    void SetMorphTarget(FName Name, float Value) { Weights[Name] = Value; }
};

class UAudioComponent {
public:
    bool bPlays = false;
    void Play() { bPlays = true; }
};

enum ELevelTick { LEVELTICK_All };
struct FActorComponentTickFunction {
    bool bCanEverTick = false;
};

class UActorComponent {
public:
    UWorld World;
    FActorComponentTickFunction PrimaryComponentTick;
    virtual ~UActorComponent() = default;
    UWorld *GetWorld() { return &World; }
    virtual void TickComponent(float, ELevelTick, FActorComponentTickFunction *) {}
};
