# Plays a sound, lets AnyfaceSpeaker follow it, and prints what its shapes and the bone are after each frame.
#     speaker.gd -- VOICE.wav EMOTION
# The word "endless" instead of a file plays half a second of a sound that has no end.
extends SceneTree

const Following := preload("res://follow.gd")

var _mesh := MeshInstance3D.new()
var _skeleton := Skeleton3D.new()
var _player := AudioStreamPlayer.new()
var _speaker: Node


func _initialize() -> void:
	var words := OS.get_cmdline_user_args()
	_mesh.mesh = Following.triangle()
	_skeleton.add_bone("Neck")
	var is_endless := words[0] == "endless"
	_player.stream = AudioStreamGenerator.new() if is_endless else AudioStreamWAV.load_from_file(words[0])
	_speaker = ClassDB.instantiate("AnyfaceSpeaker")
	_speaker.player = _player
	_speaker.mesh = _mesh
	_speaker.skeleton = _skeleton
	_speaker.head_bone = "Neck"
	_speaker.any_sound = true
	_speaker.emotion = words[1]
	_speaker.failed.connect(func(reason): print(JSON.stringify({"failed": reason})))
	_player.finished.connect(quit)
	_player.autoplay = true
	Engine.max_fps = 100
	if is_endless:
		create_timer(0.5).timeout.connect(quit)
	elif not _speaker.prepare(_player.stream):
		quit(1)
	for node in [_mesh, _skeleton, _player, _speaker]:
		root.add_child(node)
	var length: float = _player.stream.get_length()
	for frame in int(length * 25.0):
		print(JSON.stringify({"at": frame, "all": _speaker.weights_at(frame / 25.0)}))


func _process(_delta: float) -> bool:
	var weights := []
	for number in Following.SHAPES.size():
		weights.append(_mesh.get_blend_shape_value(number))
	var turn := _skeleton.get_bone_pose_rotation(0)
	var place := _player.get_playback_position()
	print(JSON.stringify({"place": place, "weights": weights, "turn": [turn.x, turn.y, turn.z, turn.w]}))
	return false
