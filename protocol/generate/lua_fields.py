"""The part of the Wireshark dissector that no catalogue changes, as Lua text.

:mod:`protocol.generate.lua` puts the catalogue's tables before it. It runs on the Lua of every
Wireshark since 3.0 (5.1 to 5.4): bits only by the bundled ``bit`` library, no integer division.
"""

from __future__ import annotations

FIELDS = r"""
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
  retry = ProtoField.bool("sweepctl.flags.retry", "retry", 8, nil, 0x02),
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
"""
