// File descriptors of links: reading and writing without blocking, and waiting for several at once.
#pragma once

#include <cerrno>
#include <cstddef>
#include <cstdint>
#include <vector>

#ifdef _WIN32
#include <winsock2.h>
#else
#include <poll.h>
#include <unistd.h>
#endif

namespace tensionlab {

using Descriptor = std::intptr_t;
constexpr Descriptor kNoDescriptor = -1;

#ifdef _WIN32  // only sockets can be waited for

using Polled = WSAPOLLFD;
inline int wait_for(std::vector<Polled>& polled) {
  return WSAPoll(polled.data(), static_cast<ULONG>(polled.size()), -1);
}
inline Polled polled_of(Descriptor file) { return {static_cast<SOCKET>(file), POLLIN, 0}; }
inline std::int64_t read_now(Descriptor file, std::uint8_t* bytes, std::size_t size) {
  return recv(static_cast<SOCKET>(file), reinterpret_cast<char*>(bytes), static_cast<int>(size), 0);
}
// How many bytes were taken, 0 if none can be now; negative if the link is broken, and the system's number why.
inline std::int64_t write_now(Descriptor file, const std::uint8_t* bytes, std::size_t size, int& error) {
  const int taken =
      send(static_cast<SOCKET>(file), reinterpret_cast<const char*>(bytes), static_cast<int>(size), 0);
  if (taken >= 0) return taken;
  error = WSAGetLastError();
  return error == WSAEWOULDBLOCK ? 0 : -1;
}

#else

using Polled = pollfd;
inline int wait_for(std::vector<Polled>& polled) {
  return poll(polled.data(), static_cast<nfds_t>(polled.size()), -1);
}
inline Polled polled_of(Descriptor file) { return {static_cast<int>(file), POLLIN, 0}; }
inline std::int64_t read_now(Descriptor file, std::uint8_t* bytes, std::size_t size) {
  return ::read(static_cast<int>(file), bytes, size);
}
// How many bytes were taken, 0 if none can be now; negative if the link is broken, and the system's number why.
inline std::int64_t write_now(Descriptor file, const std::uint8_t* bytes, std::size_t size, int& error) {
  const ssize_t taken = ::write(static_cast<int>(file), bytes, size);
  if (taken >= 0) return taken;
  error = errno;
  return error == EAGAIN || error == EWOULDBLOCK || error == EINTR ? 0 : -1;
}

#endif

}  // namespace tensionlab
