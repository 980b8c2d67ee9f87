// Waits until all invocations of the group have read and written shared memory.
void wait_for_all() {
    memoryBarrierShared();
    barrier();
}
