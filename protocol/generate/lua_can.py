"""The Wireshark dissector's reading of CAN, as Lua text, and where the whole hooks in."""

from __future__ import annotations

CAN = r"""
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

-- A native frame: fields of one part of a stream's message, then t16; or t_us, then fields.
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
  if frame.full_stamp then
    add_t_us(tree, tvb(0, 4))
  end
  if left > 0 then
    local payload = frame.full_stamp and tvb(4, left):tvb() or tvb(0, left):tvb()
    add_payload(tree, frame.fields, payload, frame.size)
  else
    tree:add_proto_expert_info(experts.payload, ("0 B, declared are %d B"):format(frame.size))
  end
  if not frame.full_stamp then
    add_t16(tree, tvb(left, 2))
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
  for _, name in ipairs({ "authenticated", "retry", "full_stamp" }) do
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
"""

REGISTRATION = r"""
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
"""
