// Where long work on one row of a batch may end early.
#pragma once

namespace tensionlab {

// Throws when the batch of the calling thread is to end: another thread failed, or Python has a signal to handle.
void checkpoint();

}  // namespace tensionlab
