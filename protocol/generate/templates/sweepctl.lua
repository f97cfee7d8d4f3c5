-- Wireshark dissector of the sweeper's wire: serial line and CAN.
-- Made by `sweepctl generate lua`; changes belong into the catalogue.
-- Protocol version @version@, catalogue 0x@hash@.
-- SPDX-License-Identifier: MIT
--
-- It belongs into the plugins folder ("About", "Folders"); or by hand:
-- tshark -X lua_script:sweepctl.lua

local VERSION = @version@
local MIN_DECODED, MAX_ENCODED = @min_decoded@, @max_encoded@ -- B, of a serial frame
local SEGMENT, MAX_SEGMENTS = @segment@, @max_segments@
local AUTH_TRAILER = @trailer@ -- B: counter and tag of a signed serial frame
local CAN_AUTH_TYPE, CAN_AUTH_SIZE = @can_auth_type@, @can_auth_size@
local OPEN_S, DOUBLE_S = @open_s@, @double_s@

-- ---- the catalogue ----------------------------------------------------------------------

local VALUES = {
@values@
}

local MESSAGES = {
@catalogue@
}

-- By the type in the identifier: which fields of which message a frame carries.
local CAN_FRAMES = {
@can_frames@
}
local CAN_TYPES = {}
for type_id in pairs(MESSAGES) do
  CAN_TYPES[type_id] = true
end
CAN_TYPES[CAN_AUTH_TYPE] = true
for can_type, frame in pairs(CAN_FRAMES) do
  CAN_TYPES[can_type] = true
  for i, index in ipairs(frame.fields) do
    frame.fields[i] = MESSAGES[frame.message].fields[index]
  end
end

-- ---- fields that Wireshark shows and filters by ------------------------------------------

local sweepctl = Proto("sweepctl", "sweepctl frame")
local sweepctl_stream = Proto("sweepctl_stream", "sweepctl bytes of a serial line")
local sweepctl_can = Proto("sweepctl_can", "sweepctl CAN frame")

local DIRECTIONS = { device = "device to host", host = "host to device" }
local TYPE_NAMES = {}
for type_id, message in pairs(MESSAGES) do
  TYPE_NAMES[type_id] = message.name
end
TYPE_NAMES[CAN_AUTH_TYPE] = "auth_tag"

local head = {
  version = ProtoField.uint8("sweepctl.version", "version", base.DEC, nil, 0xF0),
  flags = ProtoField.uint8("sweepctl.flags", "flags", base.HEX, nil, 0x0F),
  authenticated = ProtoField.bool("sweepctl.flags.authenticated", "authenticated", 8, nil, 0x01),
  full_stamp = ProtoField.bool("sweepctl.flags.full_stamp", "full stamp", 8, nil, 0x08),
  node = ProtoField.uint8("sweepctl.node", "node", base.DEC, nil, nil, "the device's id; 0: all"),
  type = ProtoField.uint8("sweepctl.type", "type", base.HEX, TYPE_NAMES),
  direction = ProtoField.string("sweepctl.direction", "direction"),
  seq = ProtoField.uint8("sweepctl.seq", "seq", base.DEC, nil, nil, "counts the sender's frames"),
  t_us = ProtoField.uint32("sweepctl.t_us", "t_us", base.DEC, nil, nil,
    "sender's clock when the content was sampled, us"),
  t16 = ProtoField.uint16("sweepctl.t16", "t16", base.DEC, nil, nil,
    "low 16 bits of the sender's clock in steps of 16 us"),
  crc = ProtoField.uint32("sweepctl.crc", "CRC-32", base.HEX),
  auth_counter = ProtoField.uint32("sweepctl.auth.counter", "auth.counter", base.DEC, nil, nil,
    "goes on from the session's challenge; on CAN its low 16 bits"),
  auth_tag = ProtoField.bytes("sweepctl.auth.tag", "auth.tag", base.NONE,
    "HMAC-SHA-256 under the device's key, cut short; not checked here"),
  damage = ProtoField.string("sweepctl.damage", "damage", base.ASCII,
    "cobs, length, crc, order (of segments), or cut (by the capture)"),
  encoded = ProtoField.bytes("sweepctl.encoded", "bytes of the line"),
  payload = ProtoField.bytes("sweepctl.payload", "payload"),
  undeclared = ProtoField.bytes("sweepctl.undeclared", "bytes beyond the declared fields"),
  unfinished = ProtoField.bytes("sweepctl.unfinished", "begun, ends in a later packet"),
  begun = ProtoField.framenum("sweepctl.begun", "begun in packet", base.NONE),
  part = ProtoField.uint8("sweepctl.can.part", "part", base.DEC, nil, nil,
    "which of the message's frames"),
  tail = ProtoField.uint8("sweepctl.can.tail", "tail", base.HEX),
  first = ProtoField.bool("sweepctl.can.start", "start", 8, nil, 0x80),
  last = ProtoField.bool("sweepctl.can.end", "end", 8, nil, 0x40),
  toggle = ProtoField.bool("sweepctl.can.toggle", "toggle", 8, nil, 0x20),
  transfer = ProtoField.uint8("sweepctl.can.transfer", "transfer", base.DEC, nil, 0x1F),
  segment = ProtoField.string("sweepctl.can.segment", "segment", base.ASCII,
    "single, first, middle, last or double"),
}
local experts = {
  cobs = ProtoExpert.new("sweepctl.bad_cobs", "not COBS",
    expert.group.MALFORMED, expert.severity.ERROR),
  length = ProtoExpert.new("sweepctl.bad_length", "no frame has this length",
    expert.group.MALFORMED, expert.severity.ERROR),
  crc = ProtoExpert.new("sweepctl.bad_crc", "CRC-32 does not hold",
    expert.group.CHECKSUM, expert.severity.ERROR),
  order = ProtoExpert.new("sweepctl.bad_order", "segments missing or out of order",
    expert.group.SEQUENCE, expert.severity.WARN),
  cut = ProtoExpert.new("sweepctl.cut", "cut short by the capture",
    expert.group.MALFORMED, expert.severity.WARN),
  version = ProtoExpert.new("sweepctl.other_version", "another protocol version",
    expert.group.UNDECODED, expert.severity.WARN),
  type = ProtoExpert.new("sweepctl.unknown_type", "unknown message type",
    expert.group.UNDECODED, expert.severity.WARN),
  payload = ProtoExpert.new("sweepctl.payload_length", "payload length is not the declared one",
    expert.group.PROTOCOL, expert.severity.WARN),
  untagged = ProtoExpert.new("sweepctl.no_tag", "marked as authenticated, and has no tag",
    expert.group.SECURITY, expert.severity.WARN),
  range = ProtoExpert.new("sweepctl.out_of_range", "value has no meaning",
    expert.group.PROTOCOL, expert.severity.NOTE),
}

local registered = {}
for _, field in pairs(head) do
  registered[#registered + 1] = field
end

local INTEGERS = {
  unsigned = { ProtoField.uint8, ProtoField.uint16, ProtoField.uint24, ProtoField.uint32 },
  signed = { ProtoField.int8, ProtoField.int16, ProtoField.int24, ProtoField.int32 },
}

-- A scaled field has two: the physical value, and the wire's integer under ".raw".
local function declare(message, field)
  local abbreviation = "sweepctl." .. message.name .. "." .. field.name
  local function keep(made)
    registered[#registered + 1] = made
    return made
  end
  if field.kind == "text" then
    field.shown = keep(ProtoField.string(abbreviation, field.name, base.UNICODE, field.doc))
  elseif field.kind == "bytes" then
    field.shown = keep(ProtoField.bytes(abbreviation, field.name, base.NONE, field.doc))
  else
    local integer = INTEGERS[field.kind][field.size]
    if field.scale then
      field.physical = keep(ProtoField.double(abbreviation, field.name, field.doc))
      field.shown = keep(integer(abbreviation .. ".raw", field.name .. ".raw", base.DEC))
    else
      local shape = field.hex and base.HEX or base.DEC
      field.shown = keep(integer(abbreviation, field.name, shape, field.values, nil, field.doc))
    end
    field.bit_fields = {}
    for _, bit_name in ipairs(field.bits or {}) do
      field.bit_fields[#field.bit_fields + 1] = keep(ProtoField.bool(
        abbreviation .. "." .. bit_name[2], bit_name[2], 8 * field.size, nil, bit_name[1]))
    end
  end
end
for _, message in pairs(MESSAGES) do
  for _, field in ipairs(message.fields) do
    declare(message, field)
  end
end

-- ---- payload -----------------------------------------------------------------------------

local function add_number(tree, field, range)
  local raw
  if field.kind == "signed" then
    raw = range:le_int()
  else
    raw = range:le_uint()
  end
  local item
  if not field.physical then
    item = tree:add_le(field.shown, range)
    if raw == field.none then
      item:append_text(", none")
    end
  elseif raw == field.none then
    item = tree:add_le(field.shown, range)
    item:set_text(field.name .. ": none (raw " .. raw .. ")")
  else
    item = tree:add(field.physical, range, raw * field.scale + field.offset)
    item:append_text(" " .. field.unit)
    item:add_le(field.shown, range)
  end
  for _, bit_field in ipairs(field.bit_fields) do
    item:add_le(bit_field, range)
  end
  if raw ~= field.none and (raw < field.low or raw > field.high) then
    item:add_proto_expert_info(experts.range,
      ("raw %d lies outside %d..%d"):format(raw, field.low, field.high))
  end
end

-- Fields one after the other; gives how many bytes they took, and whether all were there.
local function add_fields(tree, fields, tvb)
  local at, length = 0, tvb:len()
  for _, field in ipairs(fields) do
    if field.kind == "text" then
      if length > at then
        tree:add_packet_field(field.shown, tvb(at), ENC_UTF_8)
      else
        tree:add(field.shown, ""):set_generated()
      end
      return length, true
    end
    if at + field.size > length then
      return at, false
    end
    if field.kind == "bytes" then
      tree:add(field.shown, tvb(at, field.size))
    else
      add_number(tree, field, tvb(at, field.size))
    end
    at = at + field.size
  end
  return at, true
end

local function add_payload(tree, fields, tvb, declared)
  local taken, whole = add_fields(tree, fields, tvb)
  local length = tvb:len()
  local text = ("%d B, declared are %d B"):format(length, declared)
  if not whole then
    tree:add_proto_expert_info(experts.payload, text .. ": the last fields are absent")
  end
  if taken < length then
    local item = tree:add(head.undeclared, tvb(taken))
    if whole then
      item:add_proto_expert_info(experts.payload, text)
    end
  end
end

-- ---- frame of the serial line: COBS( header 8 B | payload | CRC-32 ) ---------------------

local CRC_TABLE = {}
for byte = 0, 255 do
  local register = byte
  for _ = 1, 8 do
    local lowest = register % 2
    register = (register - lowest) / 2
    if lowest == 1 then
      register = bit.bxor(register, 0xEDB88320) % 0x100000000
    end
  end
  CRC_TABLE[byte] = register
end

local function crc32(bytes, last)
  local register = 0xFFFFFFFF
  for at = 1, last do
    local low = register % 256
    register = bit.bxor(CRC_TABLE[bit.bxor(low, bytes:byte(at))], (register - low) / 256)
    register = register % 0x100000000 -- the bit library's results are signed
  end
  return 0xFFFFFFFF - register
end

-- The decoded bytes, or nil and what is wrong. No frame is long enough for the code 255.
local function cobs_decode(bytes)
  local out, at, length = {}, 1, #bytes
  while at <= length do
    local code = bytes:byte(at)
    local last = at + code - 1
    if code == 0 then
      return nil, ("a zero at byte %d"):format(at - 1)
    elseif last > length then
      return nil, ("code %d at byte %d leads past the end"):format(code, at - 1)
    end
    out[#out + 1] = bytes:sub(at + 1, last)
    if out[#out]:find("\0", 1, true) then
      return nil, ("a zero within the group at byte %d"):format(at - 1)
    end
    at = last + 1
    if at <= length then
      out[#out + 1] = "\0"
    end
  end
  return table.concat(out)
end

local function mark(tree, damage, text)
  tree:add(head.damage, damage):set_generated()
  tree:add_proto_expert_info(experts[damage], text)
  tree:append_text(", DAMAGED: " .. text)
  return "[" .. damage .. ": " .. text .. "]"
end

-- The message's fields below `tree`; gives the message's name for the packet list.
local function add_message(tree, type_id, tvb)
  local message = MESSAGES[type_id]
  if not message then
    local text = ("type 0x%02x is not in the catalogue"):format(type_id)
    tree:add_proto_expert_info(experts.type, text)
    if tvb then
      tree:add(head.payload, tvb())
    end
    return ("[type 0x%02x]"):format(type_id)
  end
  tree:add(head.direction, DIRECTIONS[message.direction]):set_generated()
  if tvb then
    add_payload(tree, message.fields, tvb, message.size)
  elseif message.size > 0 then
    tree:add_proto_expert_info(experts.payload, ("0 B, declared are %d B"):format(message.size))
  end
  return message.name
end

local function add_header(tree, tvb)
  tree:add(head.version, tvb(0, 1))
  local flags = tree:add(head.flags, tvb(0, 1))
  flags:add(head.authenticated, tvb(0, 1))
  tree:add(head.node, tvb(1, 1))
  tree:add(head.type, tvb(2, 1))
  tree:add(head.seq, tvb(3, 1))
  tree:add_le(head.t_us, tvb(4, 4)):append_text((" (%.6f s)"):format(tvb(4, 4):le_uint() / 1e6))
end

-- One stretch between delimiters, `range` its bytes as far as they are in this packet's view.
-- Gives what the packet list says of it.
local function add_stretch(tree, range, bytes, length)
  tree:add(head.encoded, range)
  if length > MAX_ENCODED then
    return mark(tree, "length", ("%d B between delimiters, at most %d"):format(length, MAX_ENCODED))
  end
  local decoded, wrong = cobs_decode(bytes)
  if not decoded then
    return mark(tree, "cobs", wrong)
  elseif #decoded < MIN_DECODED then
    return mark(tree, "length", ("%d B decoded, at least %d"):format(#decoded, MIN_DECODED))
  end
  local tvb = ByteArray.new(decoded, true):tvb("Decoded frame")
  local check_at = #decoded - 4
  local stated, computed = tvb(check_at, 4):le_uint(), crc32(decoded, check_at)
  if stated ~= computed then
    tree:add_le(head.crc, tvb(check_at, 4))
    return mark(tree, "crc", ("CRC is 0x%08x, should be 0x%08x"):format(stated, computed))
  end
  add_header(tree, tvb)
  local version, node, type_id = math.floor(decoded:byte(1) / 16), decoded:byte(2), decoded:byte(3)
  local signed = version == VERSION and decoded:byte(1) % 2 == 1
  local tag_at = check_at
  if signed and check_at - 8 >= AUTH_TRAILER then
    tag_at = check_at - AUTH_TRAILER
  end
  local payload = tag_at > 8 and tvb(8, tag_at - 8):tvb() or nil
  local name
  if version == VERSION then
    name = add_message(tree, type_id, payload)
  else
    tree:add_proto_expert_info(experts.version, ("version %d, this is %d"):format(version, VERSION))
    if payload then
      tree:add(head.payload, payload())
    end
    name = ("[version %d]"):format(version)
  end
  if tag_at < check_at then
    tree:add_le(head.auth_counter, tvb(tag_at, 4))
    tree:add(head.auth_tag, tvb(tag_at + 4, AUTH_TRAILER - 4))
    name = name .. " (signed)"
  elseif signed then
    tree:add_proto_expert_info(experts.untagged, "marked as authenticated, and has no tag")
  end
  tree:add_le(head.crc, tvb(check_at, 4)):append_text(" (good)")
  local summary = ("%s node %d seq %d"):format(name, node, decoded:byte(4))
  tree:append_text(", " .. summary)
  return summary
end

local function is_cut(tvb, tree)
  if tvb:captured_len() < tvb:reported_len() then
    mark(tree, "cut", ("%d of %d B"):format(tvb:captured_len(), tvb:reported_len()))
    return true
  end
  return false
end

-- A packet that holds one frame. Delimiters around it do no harm.
function sweepctl.dissector(tvb, pinfo, tree)
  pinfo.cols.protocol = "sweepctl"
  local root = tree:add(sweepctl, tvb())
  if is_cut(tvb, root) then
    pinfo.cols.info = "[cut short by the capture]"
    return
  end
  local bytes = tvb:raw()
  local first, last = 1, #bytes
  while first <= last and bytes:byte(first) == 0 do
    first = first + 1
  end
  while last >= first and bytes:byte(last) == 0 do
    last = last - 1
  end
  if last < first then
    root:append_text(", delimiters only")
    pinfo.cols.info = "delimiters only"
    return
  end
  local range = tvb(first - 1, last - first + 1)
  pinfo.cols.info = add_stretch(root, range, bytes:sub(first, last), last - first + 1)
end

-- A packet that holds bytes as they were read: frames begin and end anywhere. What is begun is
-- carried to the next packet of the same direction (pcapng's flag), on the first pass, which goes
-- in order. That pass shows nothing, so fields of the frame (its interface) are not known to it.

local open_stretch, carried = {}, {}

function sweepctl_stream.init()
  open_stretch, carried = {}, {}
end

local function carry(pinfo, bytes)
  local key = pinfo.p2p_dir
  local before = open_stretch[key] or { bytes = "", length = 0 }
  carried[pinfo.number] = before
  local tail = bytes:match("[^%z]*$")
  if #tail == #bytes then -- no delimiter: what was open goes on; longer than a frame is not kept
    open_stretch[key] = {
      bytes = (before.bytes .. tail):sub(1, MAX_ENCODED + 1),
      length = before.length + #tail,
      packet = before.packet or pinfo.number,
    }
  elseif tail == "" then
    open_stretch[key] = nil
  else
    local kept = tail:sub(1, MAX_ENCODED + 1)
    open_stretch[key] = { bytes = kept, length = #tail, packet = pinfo.number }
  end
end

local function add_piece(root, tvb, start, piece, before)
  if before.length == 0 then
    local range = tvb(start, #piece)
    return add_stretch(root:add(sweepctl, range), range, piece, #piece)
  end
  local whole = (before.bytes .. piece):sub(1, MAX_ENCODED + 1)
  local view = ByteArray.new(whole, true):tvb("Frame from several packets")
  local item = root:add(sweepctl, view())
  item:add(head.begun, before.packet):set_generated()
  return add_stretch(item, view(), whole, before.length + #piece)
end

function sweepctl_stream.dissector(tvb, pinfo, tree)
  pinfo.cols.protocol = "sweepctl"
  local root = tree:add(sweepctl_stream, tvb())
  if is_cut(tvb, root) then
    pinfo.cols.info = "[cut short by the capture]"
    if not pinfo.visited then
      open_stretch[pinfo.p2p_dir] = nil
    end
    return
  end
  local bytes = tvb:raw()
  if not pinfo.visited then
    carry(pinfo, bytes)
  end
  local before = carried[pinfo.number] or { bytes = "", length = 0 }
  local told, start = {}, 1
  while true do
    local zero = bytes:find("\0", start, true)
    if not zero then
      break
    end
    local piece = bytes:sub(start, zero - 1)
    if before.length + #piece > 0 then
      told[#told + 1] = add_piece(root, tvb, start - 1, piece, before)
    end
    before = { bytes = "", length = 0 }
    start = zero + 1
  end
  if start <= #bytes then
    root:add(head.unfinished, tvb(start - 1))
    told[#told + 1] = ("%d B of a frame"):format(#bytes - start + 1)
  end
  pinfo.cols.info = #told > 0 and table.concat(told, "; ") or "delimiters only"
end

-- ---- CAN: id = type << 4 | node ----------------------------------------------------------

local open_transfer, latest, segments = {}, {}, {}

function sweepctl_can.init()
  open_transfer, latest, segments = {}, {}, {}
end

local function add_t16(tree, range)
  tree:add_le(head.t16, range):append_text((" (%.6f s)"):format(range:le_uint() * 16e-6))
end

local function add_t_us(tree, range)
  tree:add_le(head.t_us, range):append_text((" (%.6f s)"):format(range:le_uint() / 1e6))
end

-- A native frame: t16 or t_us, then the fields of one part of a stream's message.
local function add_native(tree, frame, tvb)
  local message = MESSAGES[frame.message]
  tree:add(head.direction, DIRECTIONS[message.direction]):set_generated()
  if frame.parts > 1 then
    tree:add(head.part, frame.part):set_generated()
  end
  local stamp_size = frame.full_stamp and 4 or 2
  local left = tvb:len() - stamp_size
  if left < 0 then
    return mark(tree, "length", ("%d B hold no stamp"):format(tvb:len()))
  end
  local add_stamp = frame.full_stamp and add_t_us or add_t16
  add_stamp(tree, tvb(0, stamp_size))
  if left > 0 then
    add_payload(tree, frame.fields, tvb(stamp_size, left):tvb(), frame.size)
  else
    tree:add_proto_expert_info(experts.payload, ("0 B, declared are %d B"):format(frame.size))
  end
  return frame.name
end

-- What a segment is to the transfer that is open on its id. Runs once a packet, in order.
local function place_segment(key, bytes, packet, now)
  local tail, piece = bytes:byte(#bytes), bytes:sub(1, -2)
  local first, last = tail >= 0x80, tail % 0x80 >= 0x40
  local toggle, transfer = tail % 0x40 >= 0x20, tail % 0x20
  local before, open = latest[key], open_transfer[key]
  latest[key] = { bytes = bytes, at = now, packet = packet }
  if before and before.bytes == bytes and now - before.at < DOUBLE_S then
    latest[key] = before
    return { kind = "double", packet = before.packet }
  end
  local kind = last and (first and "single" or "last") or (first and "first" or "middle")
  local wrong
  open_transfer[key] = nil
  if piece == "" then
    wrong = "a segment without content"
  elseif first then
    if not toggle then
      wrong = "a first segment without its toggle bit"
    end
    open = { pieces = {}, transfer = transfer, packet = packet, began = now }
  elseif not open then
    wrong = "no transfer is open"
  elseif open.transfer ~= transfer or open.toggle == toggle then
    wrong = "a segment before it is missing"
  elseif now - open.began > OPEN_S then
    wrong = "begun too long ago"
  elseif #open.pieces >= MAX_SEGMENTS then
    wrong = "the transfer is too long"
  end
  if wrong then
    return { kind = kind, wrong = wrong }
  end
  open.pieces[#open.pieces + 1] = piece
  open.toggle = toggle
  if last then
    return { kind = kind, packet = open.packet, content = table.concat(open.pieces) }
  end
  open_transfer[key] = open
  return { kind = kind, packet = open.packet }
end

-- head | stamp | payload; gives the message's name.
local function add_content(tree, type_id, tvb)
  local length = tvb:len()
  local full = length > 0 and math.floor(tvb(0, 1):uint() / 8) % 2 == 1
  local payload_at = full and 5 or 3
  if length < payload_at then
    return mark(tree, "length", ("%d B hold no head and stamp"):format(length))
  end
  tree:add(head.version, tvb(0, 1))
  local flags = tree:add(head.flags, tvb(0, 1))
  for _, name in ipairs({ "authenticated", "full_stamp" }) do
    flags:add(head[name], tvb(0, 1))
  end
  if full then
    add_t_us(tree, tvb(1, 4))
  else
    add_t16(tree, tvb(1, 2))
  end
  local payload = length > payload_at and tvb(payload_at):tvb() or nil
  local version = math.floor(tvb(0, 1):uint() / 16)
  if version == VERSION then
    return add_message(tree, type_id, payload)
  end
  tree:add_proto_expert_info(experts.version, ("version %d, this is %d"):format(version, VERSION))
  if payload then
    tree:add(head.payload, payload())
  end
  return ("[version %d]"):format(version)
end

local function add_segment(tree, type_id, tvb, segment)
  local name = TYPE_NAMES[type_id] or ("type 0x%02x"):format(type_id)
  local tail_at = tvb:len() - 1
  local tail = tree:add(head.tail, tvb(tail_at, 1))
  for _, bit_name in ipairs({ "first", "last", "toggle", "transfer" }) do
    tail:add(head[bit_name], tvb(tail_at, 1))
  end
  tree:add(head.segment, segment.kind):set_generated()
  if segment.packet and segment.kind ~= "first" and segment.kind ~= "single" then
    tree:add(head.begun, segment.packet):set_generated()
  end
  if segment.wrong then
    return name .. " " .. mark(tree, "order", segment.wrong)
  elseif segment.kind == "single" then
    return add_content(tree, type_id, tvb(0, tail_at):tvb())
  elseif segment.kind ~= "last" then
    return ("%s, %s segment"):format(name, segment.kind)
  end
  local check_at = #segment.content - 4
  if check_at <= SEGMENT then
    return name .. " " .. mark(tree, "length", "too short for a transfer of several frames")
  end
  local whole = ByteArray.new(segment.content, true):tvb("Transfer from several frames")
  local stated, computed = whole(check_at, 4):le_uint(), crc32(segment.content, check_at)
  tree:add_le(head.crc, whole(check_at, 4))
  if stated ~= computed then
    return name .. " "
      .. mark(tree, "crc", ("CRC is 0x%08x, should be 0x%08x"):format(stated, computed))
  end
  return add_content(tree, type_id, whole(0, check_at):tvb())
end

-- The frame behind a signed message's.
local function add_tag(tree, tvb)
  if tvb:len() ~= CAN_AUTH_SIZE then
    return "auth_tag "
      .. mark(tree, "length", ("%d B, a tag has %d"):format(tvb:len(), CAN_AUTH_SIZE))
  end
  tree:add_le(head.auth_counter, tvb(0, 2))
  tree:add(head.auth_tag, tvb(2))
  return "auth_tag"
end

local function segment_of(tvb, pinfo, id)
  local packet = pinfo.number
  if not segments[packet] then
    segments[packet] = place_segment(id, tvb:raw(), packet, pinfo.abs_ts)
  end
  return segments[packet]
end

function sweepctl_can.dissector(tvb, pinfo, tree)
  pinfo.cols.protocol = "sweepctl"
  local id = pinfo.match_uint
  local type_id, node = math.floor(id / 16), id % 16
  local root = tree:add(sweepctl_can, tvb())
  root:add(head.node, node):set_generated()
  local frame = CAN_FRAMES[type_id]
  root:add(head.type, frame and frame.message or type_id):set_generated()
  local summary
  if frame then
    summary = add_native(root, frame, tvb)
  elseif type_id == CAN_AUTH_TYPE then
    summary = add_tag(root, tvb)
  elseif MESSAGES[type_id] and #MESSAGES[type_id].fields == 0 then
    summary = MESSAGES[type_id].name
  elseif tvb:len() == 0 then
    summary = (TYPE_NAMES[type_id] or "?") .. " " .. mark(root, "length", "no tail byte")
  else
    summary = add_segment(root, type_id, tvb, segment_of(tvb, pinfo, id))
  end
  summary = ("%s node %d"):format(summary, node)
  root:append_text(", " .. summary)
  pinfo.cols.info = summary
  return tvb:len()
end

-- ---- where it hooks in -------------------------------------------------------------------
-- DLT_USER0 (147): one frame a packet. DLT_USER1 (148): bytes as they were read.
-- CAN: the ids of the catalogue and of tags, no others; of one bus, or transfers of several mix.

sweepctl.fields = registered
local expert_list = {}
for _, made in pairs(experts) do
  expert_list[#expert_list + 1] = made
end
sweepctl.experts = expert_list

local encapsulations = DissectorTable.get("wtap_encap")
local encapsulation_of = wtap_encaps or wtap
encapsulations:add(encapsulation_of.USER0, sweepctl)
encapsulations:add(encapsulation_of.USER1, sweepctl_stream)

local by_id = DissectorTable.get("can.id")
for type_id, _ in pairs(CAN_TYPES) do
  for node = 0, 15 do
    by_id:add(type_id * 16 + node, sweepctl_can)
  end
end
