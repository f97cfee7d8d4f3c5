"""The Wireshark dissector's reading of the serial line, as Lua text: COBS, CRC-32, header.

Damage is judged as :class:`protocol.uart.framing.UartParser` judges it, by code of its own.
"""

from __future__ import annotations

UART = r"""
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
  flags:add(head.retry, tvb(0, 1))
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
"""
