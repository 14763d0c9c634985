# A face in Godot 4 that speaks with `anyface live --websocket`.
#
# Put it on any node, name the MeshInstance3D whose blend shapes are ARKit's (jawOpen, eyeBlinkLeft, ...) or Oculus'
# visemes (viseme_aa, ...), and, where the head is to turn, the Skeleton3D and the name of its bone.
extends Node

@export var address := "ws://127.0.0.1:8765"
@export var mesh: MeshInstance3D
@export var skeleton: Skeleton3D
@export var head_bone := "Head"

var _socket := WebSocketPeer.new()
var _places := {}
var _head := -1
var _rest := Quaternion.IDENTITY
var _wait_s := 0.0


func _ready() -> void:
	for number in mesh.get_blend_shape_count():
		_places[String(mesh.mesh.get_blend_shape_name(number))] = number
	if skeleton:
		_head = skeleton.find_bone(head_bone)
		if _head >= 0:
			_rest = skeleton.get_bone_rest(_head).basis.get_rotation_quaternion()
	_socket.connect_to_url(address)


func _process(delta: float) -> void:
	_socket.poll()
	match _socket.get_ready_state():
		WebSocketPeer.STATE_OPEN:
			var line := ""
			# Frames that came late are passed over: the newest counts.
			while _socket.get_available_packet_count() > 0:
				line = _socket.get_packet().get_string_from_utf8()
			if line != "":
				_show(JSON.parse_string(line))
		WebSocketPeer.STATE_CLOSED:
			_wait_s -= delta
			if _wait_s <= 0.0:
				_wait_s = 1.0
				_socket = WebSocketPeer.new()
				_socket.connect_to_url(address)


func _show(frame: Variant) -> void:
	if not frame is Dictionary:
		return
	# A mesh with both kinds of shapes would move its mouth twice: ARKit's go before visemes.
	var weights: Dictionary = frame.shapes if _places.has("jawOpen") else frame.visemes
	for shape in weights:
		if _places.has(shape):
			mesh.set_blend_shape_value(_places[shape], weights[shape])
	if _head >= 0:
		# Radians about the face's left, up and front: Godot's x, y and z where the face looks along +z.
		var turn := Vector3(frame.head[0], frame.head[1], frame.head[2])
		var rotation := Quaternion.IDENTITY
		if turn.length() > 0.0:
			rotation = Quaternion(turn.normalized(), turn.length())
		skeleton.set_bone_pose_rotation(_head, _rest * rotation)
